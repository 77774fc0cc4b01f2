import { expect, test } from 'vitest';
import type { Homing, Way } from '../api/types';
import { AVIATION, METRIC } from '../geo/units';
import { homingWords, wayFeatures, wayWords } from './homing';

const WAY: Way = {
  geometry: { type: 'LineString', coordinates: [[15.6, 58.4, 200], [15.61, 58.41, 200]] },
  home: { lat_deg: 58.41, lon_deg: 15.61 },
  length_m: 1260,
  seconds: 240,
  alt_amsl_m: 200,
  ground_amsl_m: 90,
  speed_m_s: 8,
  land: true,
  when_lost: 'hold',
};
const HOMING: Homing = {
  vehicle_id: '1',
  active: true,
  phase: 'follow',
  reason: '',
  way: WAY,
  remaining_m: 900,
  to_home_m: 850,
  std_horizontal_m: 1.5,
  set_point_ned_m_s: [8, 0, 0],
};

test('what waits or stands is watched, what has ended short of home is bad', () => {
  expect(homingWords(HOMING)).toEqual({ text: 'FLYING HOME', detail: '', tone: 'good' });
  const waiting = { ...HOMING, phase: 'wait' as const, reason: 'the estimator has lost the place' };
  expect(homingWords(waiting)).toEqual({ text: 'WAITING', detail: 'The estimator has lost the place.', tone: 'watch' });
  expect(homingWords({ ...HOMING, phase: 'hold' })?.tone).toBe('watch');
  expect(homingWords({ ...HOMING, active: false, phase: 'landed' })?.tone).toBe('good');
  expect(homingWords({ ...HOMING, active: false, phase: 'hold' })?.tone).toBe('bad');
  expect(homingWords({ ...HOMING, active: false, phase: null })).toBeNull();
  expect(homingWords(null)).toBeNull();
});

test('a way is told by how far, how long and how high it is', () => {
  expect(wayWords(WAY, METRIC)).toBe('1260 m, about 4 min, at 200 m above sea level: 110 m above the highest ground.');
  expect(wayWords({ ...WAY, length_m: 620, seconds: 80, ground_amsl_m: null }, AVIATION)).toBe(
    '2034 ft, about 80 s, at 656 ft above sea level: the ground below is not known.',
  );
});

test('the way is drawn longitude first', () => {
  expect(wayFeatures(WAY).features[0]?.geometry.coordinates).toEqual([[15.6, 58.4], [15.61, 58.41]]);
  expect(wayFeatures(null).features).toEqual([]);
});
