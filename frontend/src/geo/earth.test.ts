import { describe, expect, it } from 'vitest';
import { distanceM, metresPerDegree, offsetBetween, offsetBy } from './earth';

describe('metresPerDegree', () => {
  // pyproj.Geod(ellps="WGS84"), lines of 1e-4 degrees about each latitude, scaled to a degree.
  it.each([
    [0, 110574.2758, 111319.4908],
    [45, 111131.7777, 78846.8351],
    [59.9, 111410.5862, 55968.315],
  ])('agrees with a geodesic library at %s deg', (lat, north_m, east_m) => {
    const scale = metresPerDegree(lat);
    expect(scale.north_m).toBeCloseTo(north_m, 1);
    expect(scale.east_m).toBeCloseTo(east_m, 1);
  });
});

describe('offsetBy', () => {
  it('goes there and back', () => {
    const from = { lat_deg: 58.4, lon_deg: 15.6 };
    const there = offsetBy(from, 120, -75);
    const back = offsetBetween(from, there);
    expect(back.north_m).toBeCloseTo(120, 2);
    expect(back.east_m).toBeCloseTo(-75, 2);
    expect(distanceM(from, there)).toBeCloseTo(Math.hypot(120, 75), 2);
  });

  it('north raises latitude and east raises longitude', () => {
    const moved = offsetBy({ lat_deg: -33, lon_deg: 18 }, 10, 10);
    expect(moved.lat_deg).toBeGreaterThan(-33);
    expect(moved.lon_deg).toBeGreaterThan(18);
  });
});
