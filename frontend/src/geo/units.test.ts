import { describe, expect, it } from 'vitest';
import { AVIATION, climbShown, formatAxes, formatClimb, formatLength, formatSpeed, METRIC, smallShown, textIn } from './units';

describe('units', () => {
  it('leaves SI as it is', () => {
    expect([formatLength(120.4, METRIC), formatSpeed(11.26, METRIC, 1), formatClimb(-1.24, METRIC)]).toEqual(['120 m', '11.3 m/s', '−1.2 m/s']);
  });

  it('turns into those of aviation', () => {
    // 1000 ft is 304.8 m, 100 kn is 51.444 m/s (ICAO Annex 5), 500 ft/min is 2.54 m/s.
    expect([formatLength(304.8, AVIATION), formatSpeed(51.4444, AVIATION), formatClimb(2.54, AVIATION)]).toEqual(['1000 ft', '100 kn', '500 ft/min']);
  });

  it('mixes metres with kilometres an hour', () => {
    const road = { length: 'm', speed: 'km_h' } as const;
    expect([formatSpeed(10, road), formatLength(10, road), climbShown(road).name]).toEqual(['36 km/h', '10 m', 'm/s']);
  });

  it('shows small things in small units', () => {
    expect([textIn(0.0254, smallShown(METRIC)), textIn(0.0254, smallShown(AVIATION))]).toEqual(['2.5 cm', '1.0 in']);
  });

  it('shows a dash for what is not known, in every unit', () => {
    for (const units of [METRIC, AVIATION]) {
      expect([formatLength(null, units), formatSpeed(NaN, units), formatClimb(undefined, units), formatAxes(null, units)]).toEqual(['–', '–', '–', '–']);
    }
  });

  it('shows both axes of an ellipse in one unit', () => {
    expect(formatAxes({ semi_major_m: 3.048, semi_minor_m: 1.524 }, AVIATION)).toBe('10.0 × 5.0 ft');
  });
});
