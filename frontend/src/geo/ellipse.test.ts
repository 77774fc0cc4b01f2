import { describe, expect, it } from 'vitest';
import { distanceM, offsetBetween } from './earth';
import { ellipseRing } from './ellipse';

const centre = { lat_deg: 58.4, lon_deg: 15.6 };

describe('ellipseRing', () => {
  it('is closed and reaches both axes', () => {
    const ring = ellipseRing(centre, { semi_major_m: 20, semi_minor_m: 5, azimuth_deg: 0 });
    expect(ring[0]).toEqual(ring[ring.length - 1]);
    const radii = ring.map((point) => distanceM(centre, point));
    expect(Math.max(...radii)).toBeCloseTo(20, 1);
    expect(Math.min(...radii)).toBeCloseTo(5, 1);
  });

  it('turns the major axis clockwise from north', () => {
    const ring = ellipseRing(centre, { semi_major_m: 20, semi_minor_m: 5, azimuth_deg: 30 });
    const tip = offsetBetween(centre, ring[0]!);
    expect((Math.atan2(tip.east_m, tip.north_m) * 180) / Math.PI).toBeCloseTo(30, 1);
  });

  it('runs counter-clockwise, as RFC 7946 wants an outer ring', () => {
    const ring = ellipseRing(centre, { semi_major_m: 9, semi_minor_m: 4, azimuth_deg: 70 }).map((p) =>
      offsetBetween(centre, p),
    );
    let twiceArea = 0;
    for (let i = 0; i + 1 < ring.length; i++) {
      twiceArea += ring[i]!.east_m * ring[i + 1]!.north_m - ring[i + 1]!.east_m * ring[i]!.north_m;
    }
    expect(twiceArea).toBeGreaterThan(0);
  });
});
