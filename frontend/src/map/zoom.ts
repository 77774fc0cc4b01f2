/** Web-mercator zoom levels. Pure. */

const METRES_PER_PIXEL_AT_ZOOM_0 = 156543.03392804097;
const FINEST_ZOOM = 23;

/** The first level whose pixels on the ground are no larger than the imagery's. */
export function zoomForGsd(gsd_m: number, lat_deg: number): number {
  const zoom = Math.log2((METRES_PER_PIXEL_AT_ZOOM_0 * Math.cos((lat_deg * Math.PI) / 180)) / gsd_m);
  return Math.max(0, Math.min(FINEST_ZOOM, Math.ceil(zoom - 0.1)));
}
