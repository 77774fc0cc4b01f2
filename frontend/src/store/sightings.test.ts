import { describe, expect, it } from 'vitest';
import type { SightingMessage, StationMessage } from '../api/types';
import { markAt, SightingBook } from './sightings';

const at = (t_ms: number, u_px: number | null, status = 'seen') =>
  ({
    type: 'sighting', vehicle_id: '1', target_id: 't', t_frame_unix_us: t_ms * 1000, u_px, v_px: u_px === null ? null : 50,
    size_px: u_px === null ? null : 20, lat_deg: 58 + t_ms * 1e-7, lon_deg: 15, track: { status, seen_unix_us: t_ms * 1000 },
  }) as unknown as SightingMessage;

describe('markAt', () => {
  const row = [at(0, 100), at(200, 110), at(400, 120)];

  it('is exact on a picture that was looked at', () => {
    expect(markAt(row, 200_000)).toMatchObject({ u_px: 110, v_px: 50, size_px: 20, exact: true });
  });
  it('lies between two, and goes on for a moment after the last', () => {
    expect(markAt(row, 300_000)).toMatchObject({ u_px: 115, exact: false });
    expect(markAt(row, 600_000)).toMatchObject({ u_px: 130, exact: false });
    expect(markAt(row, 1_200_000)).toBeNull();
  });
  it('is nowhere before the first and where the target is not seen', () => {
    expect(markAt(row, -100_000)).toBeNull();
    expect(markAt([...row, at(600, null, 'lost')], 500_000)).toBeNull();
    expect(markAt([...row, at(600, null, 'lost')], 700_000)).toBeNull();
  });
});

describe('SightingBook', () => {
  it('draws a track of what was seen, and begins again when followed anew', () => {
    const book = new SightingBook();
    for (let i = 0; i < 20; i++) book.apply(at(200 * i, 100, i % 2 ? 'lost' : 'seen') as StationMessage);
    expect(book.trackOf('t')!.length).toBeGreaterThan(3);
    expect(book.marksAt('1', 200_000).map(({ id }) => id)).toEqual(['t']);
    expect(book.marksAt('2', 200_000)).toEqual([]);
    book.apply(at(100, 100) as StationMessage);
    expect(book.trackOf('t')!.length).toBe(1);
    book.apply({ type: 'target', action: 'deleted', target: 't' } as unknown as StationMessage);
    expect(book.trackOf('t')).toBeNull();
  });
});
