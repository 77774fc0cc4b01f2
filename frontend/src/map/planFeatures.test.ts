import { describe, expect, it } from 'vitest';
import type { PlanPath } from '../api/types';
import { addPoint, addPolygon, emptyPlan } from '../store/plan';
import { fastestOf, pathFeatures, planFeatures, speedStep } from './planFeatures';

function path(speeds: number[]): PlanPath {
  return {
    type: 'Feature',
    geometry: { type: 'LineString', coordinates: speeds.map((_, i) => [15 + i / 1000, 58]) },
    properties: {
      vehicle_id: '1', etag: 'a', length_m: 1, duration_s: 1, speed_m_s: speeds, turn_radius_m: [], alt_rel_m: [], time_s: [], arrivals: [], warnings: [],
      problems: [
        { kind: 'fence', text: 'leaves', from_item: 1, to_item: 2, lat_deg: 58, lon_deg: 15.001 },
        { kind: 'unknown', text: 'no place', from_item: null, to_item: null, lat_deg: null, lon_deg: null },
      ],
    },
  };
}

describe('a path by its speed', () => {
  it('is in pieces of one colour that join, slow ones in the first', () => {
    const drawn = pathFeatures(path([0, 1, 9, 9, 9, 12]));
    const lines = drawn.features.filter((feature) => feature.geometry.type === 'LineString');
    const ends = lines.map(({ geometry }) => geometry.coordinates as number[][]).map((places) => [places[0]![0], places[places.length - 1]![0]]);
    expect(ends[0]![0]).toBe(15);
    ends.slice(1).forEach((end, i) => expect(end[0]).toBe(ends[i]![1]));
    expect(ends[ends.length - 1]![1]).toBe(15.005);
    expect(lines.map(({ properties }) => properties.step)).toEqual([0, 2, 4, 5]);
    expect(drawn.features.filter(({ properties }) => properties.kind === 'problem')).toHaveLength(1);
  });

  it('has a scale that ends at the fastest', () => {
    expect(fastestOf(path([0, 4, 2]))).toBe(4);
    expect(fastestOf(null)).toBe(0);
    expect([speedStep(0, 6), speedStep(2.9, 6), speedStep(6, 6), speedStep(0, 0)]).toEqual([0, 2, 5, 0]);
    expect(pathFeatures({ ...path([]), geometry: null }).features).toHaveLength(1);
  });
});

describe('a plan', () => {
  it('shows its corners only while it can be changed, and which item is flown to', () => {
    const at = { lat_deg: 58, lon_deg: 15 };
    const plan = addPoint(addPolygon(emptyPlan(at), false, [at, at, at]), at, 40);
    const kinds = (editable: boolean) => planFeatures(plan, [], { kind: 'item', index: 0 }, 1, editable).features.map(({ properties }) => properties.kind);
    expect(kinds(false)).toEqual(['zone', 'home', 'item']);
    expect(kinds(true)).toEqual(['zone', 'corner', 'corner', 'corner', 'home', 'item']);
    const item = planFeatures(plan, [], { kind: 'item', index: 0 }, 1, true).features.at(-1)!;
    expect(item.properties).toMatchObject({ label: '1', selected: true, current: true });
  });
});
