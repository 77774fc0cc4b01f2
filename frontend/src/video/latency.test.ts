import { expect, it } from 'vitest';
import { RecentQuantiles } from './latency';

it('has no quantiles of nothing', () => {
  expect(new RecentQuantiles().read()).toEqual({ count: 0, median: null, p95: null });
});

it('gives median and p95 of what is recent', () => {
  const recent = new RecentQuantiles(100);
  for (let i = 0; i < 1000; i++) recent.add(1e6);
  for (let i = 0; i < 100; i++) recent.add(i);
  recent.add(NaN);
  expect(recent.read()).toEqual({ count: 1100, median: 50, p95: 95 });
  recent.clear();
  expect(recent.read().count).toBe(0);
});
