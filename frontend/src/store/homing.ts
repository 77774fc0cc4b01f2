/** What is said and drawn of a flight home by vision. Pure. */

import type { Homing, Way } from '../api/types';
import { collection, latLon, line, type Collection } from '../geo/geojson';
import { formatNumber, withUnit } from '../geo/format';
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
export function wayWords(way: Way): string {
  const high =
    way.ground_amsl_m === null
      ? 'the ground below is not known'
      : `${withUnit(way.alt_amsl_m - way.ground_amsl_m, 'm')} above the highest ground`;
  return `${distance(way.length_m)}, about ${minutes(way.seconds)}, at ${withUnit(way.alt_amsl_m, 'm')} above sea level: ${high}.`;
}

/** The way on the map. */
export function wayFeatures(way: Way | null): Collection {
  if (!way) return collection([]);
  return collection([line(way.geometry.coordinates.map(latLon), { kind: 'way' })]);
}

function distance(metres: number): string {
  return metres < 1000 ? withUnit(metres, 'm') : `${formatNumber(metres / 1000, 1)} km`;
}

function minutes(seconds: number): string {
  return seconds < 90 ? `${formatNumber(seconds, 0)} s` : `${formatNumber(seconds / 60, 0)} min`;
}
