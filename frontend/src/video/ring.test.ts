import { describe, expect, it } from 'vitest';
import type { EncodedPicture } from '../source/source';
import { PictureRing } from './ring';

const picture = (frame_id: number, key: boolean, bytes = 100) =>
  ({
    header: { frame_id, key, t_wire_unix_us: frame_id * 40_000 },
    payload: new Uint8Array(bytes),
  }) as EncodedPicture;

const filled = (count: number, group = 25, ring = new PictureRing()) => {
  for (let id = 0; id < count; id++) ring.push(picture(id, id % group === 0));
  return ring;
};

describe('PictureRing', () => {
  it('starts at a key frame', () => {
    const ring = new PictureRing();
    ring.push(picture(1, false));
    ring.push(picture(2, true));
    expect(ring.first?.header.frame_id).toBe(2);
  });

  it('keeps at least a minute and drops whole groups', () => {
    const ring = filled(3000);
    const kept_s = (ring.last!.header.t_wire_unix_us - ring.first!.header.t_wire_unix_us) / 1e6;
    expect(kept_s).toBeGreaterThanOrEqual(60);
    expect(kept_s).toBeLessThan(61.1);
    expect(ring.first?.header.key).toBe(true);
  });

  it('finds the picture taken nearest to a time, also where exposures went back a little', () => {
    const ring = new PictureRing();
    for (const [id, t_ms] of [[0, 0], [1, 100], [2, 90], [3, 200]] as const) {
      const { header, payload } = picture(id, id === 0);
      ring.push({ header: { ...header, t_unix_us: t_ms * 1000 }, payload });
    }
    expect(ring.taken(92_000, 50_000)?.header.frame_id).toBe(2);
    expect(ring.taken(240_000, 50_000)?.header.frame_id).toBe(3);
    expect(ring.taken(251_000, 50_000)).toBeUndefined();
  });

  it('never drops its only group, however old or large', () => {
    const ring = new PictureRing({ keep_us: 1_000_000, most_bytes: 1000 });
    ring.push(picture(0, true));
    for (let id = 1; id < 200; id++) ring.push(picture(id, false));
    expect(ring.length).toBe(200);
    ring.push(picture(200, true));
    expect(ring.length).toBe(1);
  });

  it('is bounded in bytes', () => {
    const ring = filled(1000, 10, new PictureRing({ keep_us: 1e12, most_bytes: 5000 }));
    expect(ring.length).toBeLessThanOrEqual(50);
    expect(ring.last?.header.frame_id).toBe(999);
  });

  it('gives what must be decoded for a picture', () => {
    const ring = filled(100);
    const ids = ring.groupUpTo(30).map((p) => p.header.frame_id);
    expect(ids).toEqual([25, 26, 27, 28, 29, 30]);
    expect(ring.groupUpTo(25)).toHaveLength(1);
    expect(ring.groupUpTo(500)).toEqual([]);
  });

  it('finds neighbours and times, held at the ends', () => {
    const ring = filled(100);
    expect(ring.neighbour(30, 1)?.header.frame_id).toBe(31);
    expect(ring.neighbour(0, -5)?.header.frame_id).toBe(0);
    expect(ring.neighbour(99, 5)?.header.frame_id).toBe(99);
    expect(ring.neighbour(-7, -1)?.header.frame_id).toBe(0);
    expect(ring.before(30.9 * 40_000)?.header.frame_id).toBe(30);
    expect(ring.before(-1)?.header.frame_id).toBe(0);
    expect(ring.get(42)?.header.frame_id).toBe(42);
  });

  it('survives gaps in the numbers', () => {
    const ring = new PictureRing();
    for (const [id, key] of [[10, true], [12, false], [15, true]] as const) ring.push(picture(id, key));
    expect(ring.get(11)).toBeUndefined();
    expect(ring.groupUpTo(12).map((p) => p.header.frame_id)).toEqual([10, 12]);
  });
});
