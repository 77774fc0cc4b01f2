import { describe, expect, it } from 'vitest';
import { collection, latLon, line, point, polygon } from './geojson';

const a = { lat_deg: 58.1, lon_deg: 15.2 };
const b = { lat_deg: 58.2, lon_deg: 15.2 };
const c = { lat_deg: 58.2, lon_deg: 15.3 };

describe('geojson', () => {
  it('puts longitude first', () => {
    expect(point(a, {}, 'x')).toEqual({
      type: 'Feature',
      id: 'x',
      geometry: { type: 'Point', coordinates: [15.2, 58.1] },
      properties: {},
    });
    expect(line([a, b], {}).geometry.coordinates).toEqual([[15.2, 58.1], [15.2, 58.2]]);
    expect(latLon([15.2, 58.1, 80])).toEqual(a);
  });

  it('closes an open ring and leaves a closed one', () => {
    expect(polygon([a, b, c], {}).geometry.coordinates[0]).toHaveLength(4);
    expect(polygon([a, b, c, a], {}).geometry.coordinates[0]).toHaveLength(4);
  });

  it('collects features', () => {
    expect(collection([point(a, {})]).features).toHaveLength(1);
  });
});
