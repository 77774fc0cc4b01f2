import { describe, expect, it } from 'vitest';
import type { StationMessage } from '../api/types';
import { offsetBy } from '../geo/earth';
import { Track, TrackBook } from './tracks';

const home = { lat_deg: 58.4, lon_deg: 15.6 };
const at = (north_m: number, t_s: number) => ({ ...offsetBy(home, north_m, 0), t_unix_us: t_s * 1e6 });
const state = (north_m: number, t_s: number, epoch = 0) =>
  ({ type: 'state', vehicle_id: '1', epoch, ...at(north_m, t_s) }) as unknown as StationMessage;

describe('Track', () => {
  it('keeps one point while the vehicle hovers', () => {
    const track = new Track();
    for (let i = 0; i < 100; i++) track.append(at(0.1 * (i % 2), i * 0.1));
    expect(track.length).toBe(1);
    track.append(at(5, 10.1));
    expect(track.pieces()).toHaveLength(1);
  });

  it('breaks at a gap and at a jump', () => {
    const track = new Track();
    for (const point of [at(0, 0), at(5, 1), at(10, 9), at(15, 10), at(400, 11), at(405, 12)]) track.append(point);
    expect(track.pieces().map((piece) => piece.length)).toEqual([2, 2, 2]);
  });

  it('stays bounded and keeps its ends', () => {
    const track = new Track();
    for (let i = 0; i < 50_000; i++) track.append(at(i, i));
    expect(track.length).toBeLessThanOrEqual(20_000);
    expect(track.pieces()[0]?.[0]?.t_unix_us).toBe(0);
    expect(track.last?.t_unix_us).toBe(49_999e6);
  });

  it('takes older points in front, without doubling', () => {
    const track = new Track();
    track.append(at(10, 10));
    track.append(at(12, 11));
    track.prime([at(0, 8), at(5, 9), at(10, 10), at(12, 11)]);
    expect(track.pieces().flat().map((p) => p.t_unix_us / 1e6)).toEqual([8, 9, 10, 11]);
  });
});

describe('TrackBook', () => {
  it('keeps GPS and vision apart, and no GPS without a fix', () => {
    const book = new TrackBook();
    book.apply(state(0, 0));
    book.apply({ type: 'gps', vehicle_id: '1', fix_type: 3, ...at(1, 0) } as unknown as StationMessage);
    book.apply({ type: 'gps', vehicle_id: '1', fix_type: 1, ...at(9, 1) } as unknown as StationMessage);
    expect([book.of('1').vision.length, book.of('1').gps.length]).toEqual([1, 1]);
  });

  it('clears trails when a new epoch begins', () => {
    const book = new TrackBook();
    expect(book.apply(state(0, 0, 1))).toBeNull();
    book.apply(state(5, 1, 1));
    expect(book.apply(state(9, 2, 2))).toBe('1');
    expect(book.of('1').vision.length).toBe(1);
  });

  it('skips positions that are not known', () => {
    const book = new TrackBook();
    book.apply({ type: 'state', vehicle_id: '1', epoch: 0, lat_deg: null, lon_deg: null, t_unix_us: 1 } as unknown as StationMessage);
    expect(book.of('1').vision.length).toBe(0);
  });

  it('begins again at each hello, so that an interruption leaves no hole', () => {
    const book = new TrackBook();
    book.apply(state(0, 0));
    book.apply({ type: 'hello', vehicles: [{ id: '1' }] } as StationMessage);
    expect(book.of('1').vision.length).toBe(0);
  });

  it('is primed from the station', () => {
    const book = new TrackBook();
    book.apply(state(20, 20));
    book.prime('1', 'vision', {
      type: 'FeatureCollection',
      features: [
        {
          type: 'Feature',
          geometry: { type: 'LineString', coordinates: [[15.6, 58.4, 80], [15.6, 58.4001, 80]] },
          properties: { source: 'vision', vehicle_id: '1', epoch: 0, times_unix_us: [18e6, 19e6] },
        },
      ],
    });
    expect(book.of('1').vision.length).toBe(3);
  });

  it('takes only the present epoch of what the station remembers', () => {
    const book = new TrackBook();
    const piece = (epoch: number, lon_deg: number) => ({
      type: 'Feature' as const,
      geometry: { type: 'LineString' as const, coordinates: [[lon_deg, 58.4], [lon_deg, 58.401]] },
      properties: { source: 'gps', vehicle_id: '1', epoch, times_unix_us: [1e6, 2e6] },
    });
    book.prime('1', 'gps', { type: 'FeatureCollection', features: [piece(1, 15.5), piece(2, 15.6)] });
    expect(book.of('1').gps.length).toBe(2);
    expect(book.of('1').gps.last?.lon_deg).toBe(15.6);
  });
});
