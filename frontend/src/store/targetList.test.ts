import { describe, expect, it } from 'vitest';
import type { Target } from '../api/types';
import { chosenTargets, copyText, heightWords, isFiltered, methodsOf, WHOLE_LIST, type ListChoice } from './targetList';

const NOW_US = 1_000e6;

function target(id: string, name: string, age_s: number, ce90_m: number | null, method: string): Target {
  const properties = { name, created_unix_us: NOW_US - age_s * 1e6, ce90_m, method };
  return { type: 'Feature', id, properties } as unknown as Target;
}

const TARGETS = [
  target('1', 'Target 10', 30, 2.5, 'ray_terrain'),
  target('2', 'barn', 700, null, 'manual'),
  target('3', 'Target 9', 10, 8, 'ray_flat'),
  target('4', 'Barn door', 700, 1.5, 'ray_terrain'),
];

const ids = (choice: Partial<ListChoice>) => chosenTargets(TARGETS, { ...WHOLE_LIST, ...choice }, NOW_US).map((t) => t.id);

describe('chosenTargets', () => {
  it('has the youngest first unless told otherwise', () => {
    expect(ids({})).toEqual(['3', '1', '2', '4']);
    expect(ids({ descending: true })).toEqual(['2', '4', '1', '3']);
  });

  it('sorts names as people do, and unknown accuracy last', () => {
    expect(ids({ sort: 'name' })).toEqual(['2', '4', '3', '1']);
    expect(ids({ sort: 'ce90' })).toEqual(['4', '1', '3', '2']);
    expect(ids({ sort: 'method' })).toEqual(['2', '3', '1', '4']);
  });

  it('filters by everything at once', () => {
    expect(ids({ name: ' BARN ' })).toEqual(['2', '4']);
    expect(ids({ name: 'barn', most_ce90_m: 5 })).toEqual(['4']);
    expect(ids({ most_age_s: 60 })).toEqual(['3', '1']);
    expect(ids({ method: 'ray to terrain', most_age_s: 60 })).toEqual(['1']);
    expect(ids({ most_ce90_m: 0.1 })).toEqual([]);
  });

  it('leaves the given list as it was', () => {
    const before = TARGETS.map((t) => t.id);
    ids({ sort: 'name' });
    expect(TARGETS.map((t) => t.id)).toEqual(before);
  });

  it('knows whether something is left out by choice', () => {
    expect(isFiltered({ ...WHOLE_LIST, sort: 'name', name: ' ' })).toBe(false);
    expect(isFiltered({ ...WHOLE_LIST, most_ce90_m: 3 })).toBe(true);
  });

  it('lists each method once', () => {
    expect(methodsOf(TARGETS)).toEqual(['entered by hand', 'ray to flat ground', 'ray to terrain']);
  });
});

describe('copyText', () => {
  const place = { lat_deg: 47.3769, lon_deg: 8.5417, mgrs: '32TMT6540347151', utm: '32T 465403 5247151', dms: '47°22′36.84″N 008°32′30.12″E' };

  it('is the coordinate in the chosen format, and nothing else', () => {
    expect(copyText(place, 'dd')).toBe('47.3769000, 8.5417000');
    expect(copyText(place, 'dms')).toBe(place.dms);
    expect(copyText(place, 'utm')).toBe(place.utm);
    expect(copyText(place, 'mgrs')).toBe('32T MT 65403 47151');
  });

  it('has a dash where a grid does not reach', () => {
    expect(copyText({ ...place, lat_deg: 89, utm: null }, 'utm')).toBe('–');
  });
});

describe('heightWords', () => {
  it('says what is not usual', () => {
    expect(heightWords({ height_above_ground_m: 0, ground: 'terrain' })).toBe('');
    expect(heightWords({ height_above_ground_m: null, ground: null })).toBe('');
    expect(heightWords({ height_above_ground_m: 0, ground: 'flat' })).toBe('flat ground');
    expect(heightWords({ height_above_ground_m: 4.5, ground: 'terrain' })).toBe('4.5 m above the terrain');
    expect(heightWords({ height_above_ground_m: -2, ground: 'flat' })).toBe('2.0 m below flat ground');
  });
});
