/** Finds actions by a few letters. Pure. */

export interface Named {
  id: string;
  label: string;
  group: string;
}

/** How well a label answers what was typed: every word must begin somewhere in it, or at least stand in it. Null when not. */
export function matchScore(label: string, query: string): number | null {
  const text = label.toLocaleLowerCase('en');
  let score = 0;
  for (const word of query.toLocaleLowerCase('en').split(/\s+/).filter(Boolean)) {
    const at = text.indexOf(word);
    if (at < 0) return null;
    const begins = at === 0 || new RegExp(`[^\\p{L}\\p{N}]${escaped(word)}`, 'u').test(text);
    score += at === 0 ? 3 : begins ? 2 : 1;
  }
  return score;
}

function escaped(word: string): string {
  return word.replace(/[.*+?^${}()|[\]\\/-]/g, '\\$&');
}

/** Best first; equals stay in their order. The group counts as part of the label, for less. */
export function found<T extends Named>(actions: readonly T[], query: string): T[] {
  if (query.trim() === '') return [...actions];
  return actions
    .map((action) => ({ action, score: matchScore(action.label, query) ?? half(matchScore(`${action.group} ${action.label}`, query)) }))
    .filter((one): one is { action: T; score: number } => one.score !== null)
    .sort((a, b) => b.score - a.score)
    .map(({ action }) => action);
}

function half(score: number | null): number | null {
  return score === null ? null : score / 2;
}
