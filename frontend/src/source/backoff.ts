/** Waiting times between attempts: doubling up to a limit, spread so that many consoles do not come back at once. */

const FIRST_MS = 400;
const LONGEST_MS = 5000;

/** `spread` in [0, 1) takes up to a quarter off. */
export function backoffMs(attempt: number, spread: number): number {
  const full = Math.min(LONGEST_MS, FIRST_MS * 2 ** Math.min(attempt, 10));
  return Math.round(full * (1 - 0.25 * spread));
}
