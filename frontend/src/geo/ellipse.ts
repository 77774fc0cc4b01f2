/** Error ellipses as rings of points. Pure. */

import { offsetBy, type LatLon } from './earth';

export interface EllipseAxes {
  semi_major_m: number;
  semi_minor_m: number;
  /** Of the major axis, clockwise from north. */
  azimuth_deg: number;
}

/** A closed ring (first point repeated), counter-clockwise as seen from above. */
export function ellipseRing(centre: LatLon, axes: EllipseAxes, points = 48): LatLon[] {
  const azimuth = (axes.azimuth_deg * Math.PI) / 180;
  const ring: LatLon[] = [];
  for (let i = 0; i <= points; i++) {
    const phase = (-2 * Math.PI * (i % points)) / points;
    const along = axes.semi_major_m * Math.cos(phase);
    const across = axes.semi_minor_m * Math.sin(phase);
    ring.push(
      offsetBy(
        centre,
        along * Math.cos(azimuth) - across * Math.sin(azimuth),
        along * Math.sin(azimuth) + across * Math.cos(azimuth),
      ),
    );
  }
  return ring;
}
