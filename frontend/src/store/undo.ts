/** What was, to go back to. Pure. */

const KEPT = 100;

export interface History<T> {
  readonly past: readonly T[];
  readonly future: readonly T[];
}

export const NO_HISTORY: History<never> = { past: [], future: [] };

export function noted<T>(history: History<T>, before: T): History<T> {
  return { past: [...history.past, before].slice(-KEPT), future: [] };
}

/** Null where there is nothing to go back to. */
export function undone<T>(history: History<T>, now: T): { history: History<T>; now: T } | null {
  const back = history.past[history.past.length - 1];
  if (back === undefined) return null;
  return { history: { past: history.past.slice(0, -1), future: [now, ...history.future] }, now: back };
}

export function redone<T>(history: History<T>, now: T): { history: History<T>; now: T } | null {
  const next = history.future[0];
  if (next === undefined) return null;
  return { history: { past: [...history.past, now], future: history.future.slice(1) }, now: next };
}
