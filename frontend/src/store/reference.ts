/** Which imagery is on screen, in words: an operator must see where a picture comes from and where it ends. Pure. */

import type { MapSummary, StateMessage } from '../api/types';
import { formatLength, METRIC, type Units } from '../geo/units';

export function covers(map: MapSummary, lat_deg: number, lon_deg: number): boolean {
  const { south_deg, north_deg, west_deg, east_deg } = map.bounds;
  return lat_deg >= south_deg && lat_deg <= north_deg && lon_deg >= west_deg && lon_deg <= east_deg;
}

export function activeReference(maps: readonly MapSummary[], state: StateMessage | null, units: Units = METRIC): string {
  const imagery = maps.filter((map) => map.kind === 'imagery');
  if (imagery.length === 0) return 'No reference imagery: import a GeoTIFF';
  const words = (map: MapSummary) => `${map.name} (${formatLength(map.gsd_m, units, 2)}/px)`;
  if (!state || state.lat_deg === null || state.lon_deg === null) return imagery.map(words).join(', ');
  const here = imagery.filter((map) => covers(map, state.lat_deg!, state.lon_deg!));
  if (here.length === 0) return 'No reference imagery under the aircraft';
  return words(here.reduce((best, map) => ((map.gsd_m ?? Infinity) < (best.gsd_m ?? Infinity) ? map : best)));
}
