import { expect, it } from 'vitest';
import type { MapSummary, StateMessage } from '../api/types';
import { activeReference } from './reference';

const map = (name: string, gsd_m: number, west_deg: number, kind = 'imagery') =>
  ({ id: name, name, kind, gsd_m, bounds: { south_deg: 58, north_deg: 59, west_deg, east_deg: west_deg + 1 } }) as MapSummary;
const at = (lon_deg: number) => ({ lat_deg: 58.5, lon_deg }) as StateMessage;

it('names the finest imagery under the aircraft', () => {
  const maps = [map('coarse', 2, 15), map('fine', 0.25, 15), map('ground', 0.1, 15, 'elevation')];
  expect(activeReference(maps, at(15.5))).toBe('fine (0.25 m/px)');
});

it('says when there is none', () => {
  expect(activeReference([], null)).toContain('import a GeoTIFF');
  expect(activeReference([map('a', 1, 15)], at(20))).toBe('No reference imagery under the aircraft');
  expect(activeReference([map('a', 1, 15)], null)).toBe('a (1.00 m/px)');
});
