import { describe, expect, it } from 'vitest';
import type { Footprint } from '../api/types';
import { affine, outlineOf, shifted, trianglesOf, type Point } from './drape';

const GRID: Footprint = {
  frame_id: 1, t_unix_us: 1, width_px: 640, height_px: 480, columns: 3, rows: 2,
  u_px: [-0.5, 319.5, 639.5], v_px: [-0.5, 479.5],
  points: [[2, 0], [2, 1], [2, 2], [0, 0], [0, 1], [0, 2]],
  centre: [1, 1], ce90_m: 2,
};

const area = (points: readonly Point[]) => {
  const [a, b, c] = points as [Point, Point, Point];
  return Math.abs((b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y)) / 2;
};

describe('trianglesOf', () => {
  it('covers the whole picture once', () => {
    const triangles = trianglesOf(GRID);
    expect(triangles).toHaveLength(4);
    expect(triangles.reduce((sum, t) => sum + area(t), 0)).toBeCloseTo(640 * 480, 6);
    expect(triangles.flat().every((corner) => corner.lat_deg === (corner.y === 0 ? 2 : 0))).toBe(true);
  });

  it('leaves out what shows no ground, and no more', () => {
    for (const gone of [0, 1, 2, 3, 4, 5]) {
      const points = GRID.points.map((point, i) => (i === gone ? null : point));
      const covered = trianglesOf({ ...GRID, points }).reduce((sum, t) => sum + area(t), 0);
      // A corner of the picture belongs to one cell, the points between to two.
      const cells = gone === 1 || gone === 4 ? 2 : 1;
      expect(covered).toBeCloseTo(640 * 480 - cells * 320 * 480 * 0.5, 6);
    }
    expect(trianglesOf({ ...GRID, points: GRID.points.map(() => null) })).toEqual([]);
  });
});

describe('affine', () => {
  it('takes each point where it belongs', () => {
    const from: [Point, Point, Point] = [{ x: 0, y: 0 }, { x: 320, y: 10 }, { x: 30, y: 480 }];
    const to: [Point, Point, Point] = [{ x: 100, y: 50 }, { x: 70, y: 90 }, { x: -20, y: 44 }];
    const [a, b, c, d, e, f] = affine(from, to)!;
    from.forEach((p, i) => {
      expect(a * p.x + c * p.y + e).toBeCloseTo(to[i]!.x, 9);
      expect(b * p.x + d * p.y + f).toBeCloseTo(to[i]!.y, 9);
    });
  });

  it('has nothing to say of three points on a line', () => {
    const line: [Point, Point, Point] = [{ x: 0, y: 0 }, { x: 1, y: 1 }, { x: 2, y: 2 }];
    expect(affine(line, line)).toBeNull();
  });
});

describe('outlineOf', () => {
  it('goes once around', () => {
    expect(outlineOf(GRID).map((p) => [p.lat_deg, p.lon_deg])).toEqual([[2, 0], [2, 1], [2, 2], [0, 2], [0, 1], [0, 0]]);
  });
});

describe('shifted', () => {
  it('moves every point that there is', () => {
    const moved = shifted({ ...GRID, points: [null, ...GRID.points.slice(1)] }, 0.5, -0.25);
    expect(moved.points[0]).toBeNull();
    expect(moved.points[5]).toEqual([0.5, 1.75]);
    expect(shifted(GRID, 0, 0)).toBe(GRID);
  });
});
