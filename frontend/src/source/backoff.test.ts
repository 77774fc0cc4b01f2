import { expect, it } from 'vitest';
import { backoffMs } from './backoff';

it('doubles up to a limit', () => {
  expect([0, 1, 2, 3, 4, 50].map((n) => backoffMs(n, 0))).toEqual([400, 800, 1600, 3200, 5000, 5000]);
});

it('spreads by at most a quarter, downwards', () => {
  expect(backoffMs(2, 0.999)).toBeGreaterThanOrEqual(1200);
  expect(backoffMs(2, 0.5)).toBe(1400);
});
