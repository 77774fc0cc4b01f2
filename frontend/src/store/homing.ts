/** What is said and drawn of a flight home by vision. Pure. */

import type { Homing, Way } from '../api/types';
import { collection, latLon, line, type Collection } from '../geo/geojson';
import { formatNumber } from '../geo/format';
import { formatLength, type Units } from '../geo/units';
import { sentence } from './landing';
import type { Words } from './words';

const PHASES: Record<NonNullable<Homing['phase']>, string> = {
  climb: 'TO THE WAY',
  follow: 'FLYING HOME',
  arrive: 'OVER HOME',
  descend: 'DESCENDING',
  touchdown: 'TOUCHING DOWN',
  wait: 'WAITING',
  landed: 'LANDED AT HOME',
  abort: 'FLIGHT HOME ENDED',
  hold: 'HOLDING BY VISION',
};

/** How far the flight home is, or how the last one ended; null where there was none. */
export function homingWords(homing: Homing | null): Words | null {
  if (!homing?.phase) return null;
  const detail = homing.reason ? sentence(homing.reason) : '';
  if (!homing.active) return { text: PHASES[homing.phase], detail, tone: homing.phase === 'landed' ? 'good' : 'bad' };
  const watched = homing.phase === 'hold' || homing.phase === 'wait';
  return { text: PHASES[homing.phase], detail, tone: watched ? 'watch' : 'good' };
}

/** A way in one line: how far, how long, how high. */
export function wayWords(way: Way, units: Units): string {
  const high =
    way.ground_amsl_m === null
      ? 'the ground below is not known'
      : `${formatLength(way.alt_amsl_m - way.ground_amsl_m, units)} above the highest ground`;
  return `${formatLength(way.length_m, units)}, about ${minutes(way.seconds)}, at ${formatLength(way.alt_amsl_m, units)} above sea level: ${high}.`;
}

/** The way on the map. */
export function wayFeatures(way: Way | null): Collection {
  if (!way) return collection([]);
  return collection([line(way.geometry.coordinates.map(latLon), { kind: 'way' })]);
}

function minutes(seconds: number): string {
  return seconds < 90 ? `${formatNumber(seconds, 0)} s` : `${formatNumber(seconds / 60, 0)} min`;
}
