/** Where the aircraft is to go, as GeoJSON. Pure. */

import type { LatLon } from '../geo/earth';
import { ellipseRing } from '../geo/ellipse';
import { collection, point, polygon, type Collection, type PointGeometry, type PolygonGeometry } from '../geo/geojson';

/** The place, and the orbit about it. */
export function gotoFeatures(place: LatLon | null, radius_m: number | null): Collection {
  if (!place) return collection([]);
  const mark = point(place, { kind: 'goto' });
  if (radius_m === null) return collection([mark]);
  const ring = ellipseRing(place, { semi_major_m: radius_m, semi_minor_m: radius_m, azimuth_deg: 0 });
  return collection<PointGeometry | PolygonGeometry, Record<string, unknown>>([polygon(ring, { kind: 'orbit' }), mark]);
}
