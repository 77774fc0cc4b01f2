import { expect, it } from 'vitest';
import { headingTape, horizonTransform, HUD } from './hud';

it('rolls against the aircraft and sinks when the nose rises', () => {
  expect(horizonTransform(10, 5)).toBe('translate(320 240) rotate(-10.00) translate(0 30.00)');
});

it('labels the tape and puts the heading in the middle', () => {
  const marks = headingTape(90);
  expect(marks.find((mark) => mark.label === 'E')?.x).toBe(HUD.width / 2);
  expect(marks).toHaveLength(15);
});

it('runs through north', () => {
  const marks = headingTape(355);
  expect(marks.find((mark) => mark.label === 'N')?.x).toBeCloseTo(HUD.width / 2 + 5 * HUD.tapeDegree, 6);
  expect(marks.some((mark) => mark.label === '345')).toBe(true);
});
