/** Small-area geodesy on WGS-84, enough to draw with. Pure; angles in degrees as on the wire. */

export const WGS84_A_M = 6378137;
export const WGS84_F = 1 / 298.257223563;
const E2 = WGS84_F * (2 - WGS84_F);
const RAD_PER_DEG = Math.PI / 180;

export interface LatLon {
  lat_deg: number;
  lon_deg: number;
}

/** Metres per degree of latitude and of longitude at a latitude. */
export function metresPerDegree(lat_deg: number): { north_m: number; east_m: number } {
  const sin = Math.sin(lat_deg * RAD_PER_DEG);
  const w = Math.sqrt(1 - E2 * sin * sin);
  const meridian_m = (WGS84_A_M * (1 - E2)) / (w * w * w);
  const transverse_m = WGS84_A_M / w;
  return {
    north_m: meridian_m * RAD_PER_DEG,
    east_m: transverse_m * Math.cos(lat_deg * RAD_PER_DEG) * RAD_PER_DEG,
  };
}

/** The point a short way off. Tangent-plane scale: better than 1e-4 of the offset below 1 km. */
export function offsetBy(from: LatLon, north_m: number, east_m: number): LatLon {
  const scale = metresPerDegree(from.lat_deg);
  return { lat_deg: from.lat_deg + north_m / scale.north_m, lon_deg: from.lon_deg + east_m / scale.east_m };
}

/** North and east of `to` as seen from `from`, for short distances. */
export function offsetBetween(from: LatLon, to: LatLon): { north_m: number; east_m: number } {
  const scale = metresPerDegree((from.lat_deg + to.lat_deg) / 2);
  return {
    north_m: (to.lat_deg - from.lat_deg) * scale.north_m,
    east_m: (to.lon_deg - from.lon_deg) * scale.east_m,
  };
}

export function distanceM(from: LatLon, to: LatLon): number {
  const { north_m, east_m } = offsetBetween(from, to);
  return Math.hypot(north_m, east_m);
}
