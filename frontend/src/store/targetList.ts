/** The list of targets as the operator wants it: sorted, filtered, in words. Pure. */

import type { Target, TargetProperties } from '../api/types';
import { formatCoordinate, formatMgrs, type CoordinateFormat } from '../geo/format';
import { formatLength, METRIC, type Units } from '../geo/units';
import { methodWords } from './words';

export const SORTS = { age: 'Age', name: 'Name', ce90: 'CE90', method: 'Method' } as const;
export type SortKey = keyof typeof SORTS;

export interface ListChoice {
  sort: SortKey;
  descending: boolean;
  /** A part of the name, in any case. */
  name: string;
  /** As `methodWords` says it; empty for all. */
  method: string;
  /** Not older than this; null for any age. */
  most_age_s: number | null;
  /** Not worse than this; null for any. Targets of unknown accuracy are worse than every number. */
  most_ce90_m: number | null;
}

export const WHOLE_LIST: ListChoice = {
  sort: 'age', descending: false, name: '', method: '', most_age_s: null, most_ce90_m: null,
};

const COMPARE: Record<SortKey, (a: TargetProperties, b: TargetProperties) => number> = {
  // The youngest first, as age goes up.
  age: (a, b) => b.created_unix_us - a.created_unix_us,
  name: (a, b) => a.name.localeCompare(b.name, 'en', { numeric: true, sensitivity: 'base' }),
  ce90: (a, b) => known(a.ce90_m) - known(b.ce90_m),
  method: (a, b) => methodWords(a.method).localeCompare(methodWords(b.method), 'en'),
};

function known(value: number | null): number {
  return value ?? Number.MAX_VALUE;
}

export function isFiltered(choice: ListChoice): boolean {
  return choice.name.trim() !== '' || choice.method !== '' || choice.most_age_s !== null || choice.most_ce90_m !== null;
}

export function chosenTargets(targets: readonly Target[], choice: ListChoice, now_us: number): Target[] {
  const part = choice.name.trim().toLocaleLowerCase('en');
  const shown = targets.filter(({ properties: p }) => {
    if (part !== '' && !p.name.toLocaleLowerCase('en').includes(part)) return false;
    if (choice.method !== '' && methodWords(p.method) !== choice.method) return false;
    if (choice.most_age_s !== null && now_us - p.created_unix_us > choice.most_age_s * 1e6) return false;
    return choice.most_ce90_m === null || known(p.ce90_m) <= choice.most_ce90_m;
  });
  const compare = COMPARE[choice.sort];
  const sign = choice.descending ? -1 : 1;
  // Equals keep one order, whichever way the others go.
  return shown.sort((a, b) => sign * compare(a.properties, b.properties) || COMPARE.age(a.properties, b.properties) || (a.id < b.id ? -1 : 1));
}

export function methodsOf(targets: readonly Target[]): string[] {
  return [...new Set(targets.map((target) => methodWords(target.properties.method)))].sort((a, b) => a.localeCompare(b, 'en'));
}

/** What the copy button copies: to the centimetre in degrees, to the metre in grids, as another program can read it. */
export function copyText(p: Pick<TargetProperties, 'lat_deg' | 'lon_deg' | 'mgrs' | 'utm' | 'dms'>, format: CoordinateFormat): string {
  switch (format) {
    case 'dd':
      return `${p.lat_deg.toFixed(7)}, ${p.lon_deg.toFixed(7)}`;
    case 'dm':
      return formatCoordinate(p, 'dm');
    case 'dms':
      return p.dms;
    case 'mgrs':
      return p.mgrs === null ? formatCoordinate(p, 'mgrs') : formatMgrs(p.mgrs);
    case 'utm':
      return p.utm ?? formatCoordinate(p, 'utm');
  }
}

/** At which height above what a target was located; empty where that goes without saying. */
export function heightWords(p: Pick<TargetProperties, 'height_above_ground_m' | 'ground'>, units: Units = METRIC): string {
  const height = p.height_above_ground_m ?? 0;
  if (height === 0) return p.ground === 'flat' ? 'flat ground' : '';
  const side = height < 0 ? 'below' : 'above';
  return `${formatLength(Math.abs(height), units, 1)} ${side} ${p.ground === 'flat' ? 'flat ground' : 'the terrain'}`;
}
