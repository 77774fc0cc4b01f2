import { expect, it } from 'vitest';
import { zoomForGsd } from './zoom';

it('is at least as fine as the imagery, and never finer than the finest level', () => {
  // At the equator level 18 has 0.597 m a pixel; at 60 degrees half of that.
  expect(zoomForGsd(0.6, 0)).toBe(18);
  expect(zoomForGsd(0.5, 0)).toBe(19);
  expect(zoomForGsd(0.3, 60)).toBe(18);
  expect(zoomForGsd(0.001, 0)).toBe(23);
  expect(zoomForGsd(1e9, 0)).toBe(0);
});
