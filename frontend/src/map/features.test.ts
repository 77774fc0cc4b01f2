import { describe, expect, it } from 'vitest';
import type { GpsMessage, StateMessage, Target } from '../api/types';
import { newVehicle } from '../store/mission';
import { Track } from '../store/tracks';
import {
  ellipseFeatures,
  footprintFeatures,
  gpsFeatures,
  targetEllipseFeatures,
  targetFeatures,
  trackFeatures,
  vehicleFeatures,
} from './features';

const ellipse95 = { semi_major_m: 5, semi_minor_m: 2, azimuth_deg: 20 };
const vehicle = (id: string, state: object) => ({
  ...newVehicle(id),
  state: { lat_deg: 58.4, lon_deg: 15.6, heading_deg: 90, mode: 'vision', ellipse95, footprint: null, ...state } as StateMessage,
});
const target = { id: 't', properties: { name: 'Barn', lat_deg: 58.4, lon_deg: 15.6, ellipse95 } } as unknown as Target;

describe('features', () => {
  it('draws a track in pieces', () => {
    const track = new Track();
    for (const t of [0, 1, 10, 11]) track.append({ lat_deg: 58.4 + t * 1e-4, lon_deg: 15.6, t_unix_us: t * 1e6 });
    const features = trackFeatures(track, 'gps').features;
    expect(features.map((f) => f.geometry.coordinates.length)).toEqual([2, 2]);
    expect(features[0]?.geometry.coordinates[0]).toEqual([15.6, 58.4]);
  });

  it('draws nothing for an unknown position', () => {
    expect(ellipseFeatures(vehicle('1', { lat_deg: null })).features).toEqual([]);
    expect(ellipseFeatures(vehicle('1', { ellipse95: null })).features).toEqual([]);
    expect(vehicleFeatures([vehicle('1', { lon_deg: null })], '1').features).toEqual([]);
    expect(footprintFeatures(null).features).toEqual([]);
  });

  it('puts the selected vehicle on top', () => {
    const features = vehicleFeatures([vehicle('1', {}), vehicle('2', {})], '1').features;
    expect(features.map((f) => f.id)).toEqual(['2', '1']);
    expect(features[1]?.properties).toMatchObject({ heading_deg: 90, selected: true });
  });

  it('closes the footprint and the ellipses', () => {
    const corners = [[58.4, 15.6], [58.4, 15.7], [58.3, 15.7], [58.3, 15.6]];
    const ring = footprintFeatures(vehicle('1', { footprint: corners })).features[0]!.geometry.coordinates[0] as number[][];
    expect(ring).toHaveLength(5);
    expect(ring[0]).toEqual([15.6, 58.4]);
    expect(ellipseFeatures(vehicle('1', {})).features).toHaveLength(1);
    expect(targetEllipseFeatures([target], 't').features[0]?.properties).toEqual({ selected: true });
  });

  it('shows GPS only with a fix', () => {
    const gps = (fix_type: number) => ({ ...newVehicle('1'), gps: { fix_type, lat_deg: 1, lon_deg: 2, used: false } as GpsMessage });
    expect(gpsFeatures(gps(1)).features).toEqual([]);
    expect(gpsFeatures(gps(3)).features[0]?.geometry.coordinates).toEqual([2, 1]);
  });

  it('names targets', () => {
    expect(targetFeatures([target], null).features[0]).toMatchObject({ id: 't', properties: { name: 'Barn', selected: false } });
  });
});
