/** A video frame laid on the map: its grid of pixels cut into triangles, each drawn by an affine map. Pure. */

import type { Footprint } from '../api/types';
import type { LatLon } from '../geo/earth';

/** A corner of a triangle: where in the picture (pixels from its top-left edge), and where on the ground. */
export interface Corner extends LatLon {
  x: number;
  y: number;
}

export type Triangle = readonly [Corner, Corner, Corner];

/** The triangles of a footprint, without those of which a corner shows no known ground. */
export function trianglesOf(grid: Footprint): Triangle[] {
  const corner = (row: number, column: number): Corner | null => {
    const place = grid.points[row * grid.columns + column];
    if (!place) return null;
    // Pixel (0, 0) is the centre of the top-left pixel.
    return { x: grid.u_px[column]! + 0.5, y: grid.v_px[row]! + 0.5, lat_deg: place[0]!, lon_deg: place[1]! };
  };
  const triangles: Triangle[] = [];
  for (let row = 0; row + 1 < grid.rows; row++) {
    for (let column = 0; column + 1 < grid.columns; column++) {
      const a = corner(row, column);
      const b = corner(row, column + 1);
      const c = corner(row + 1, column + 1);
      const d = corner(row + 1, column);
      if (a && b && c) triangles.push([a, b, c]);
      if (a && c && d) triangles.push([a, c, d]);
      // Three of four still make a triangle.
      if (!a && b && c && d) triangles.push([b, c, d]);
      if (!c && a && b && d) triangles.push([a, b, d]);
    }
  }
  return triangles;
}

export interface Point {
  x: number;
  y: number;
}

/** a, b, c, d, e, f of a canvas' `transform` that takes three points to three others; null where they lie on a line. */
export function affine(from: readonly [Point, Point, Point], to: readonly [Point, Point, Point]): [number, number, number, number, number, number] | null {
  const [p, q, r] = from;
  const det = (q.x - p.x) * (r.y - p.y) - (r.x - p.x) * (q.y - p.y);
  if (Math.abs(det) < 1e-9) return null;
  const solve = (P: number, Q: number, R: number): [number, number, number] => {
    const x = ((Q - P) * (r.y - p.y) - (R - P) * (q.y - p.y)) / det;
    const y = ((R - P) * (q.x - p.x) - (Q - P) * (r.x - p.x)) / det;
    return [x, y, P - x * p.x - y * p.y];
  };
  const [a, c, e] = solve(to[0].x, to[1].x, to[2].x);
  const [b, d, f] = solve(to[0].y, to[1].y, to[2].y);
  return [a, b, c, d, e, f];
}

/** The edge of what is covered, clockwise in the picture from its top-left corner; corners without ground are left out. */
export function outlineOf(grid: Footprint): LatLon[] {
  const { rows, columns } = grid;
  const ring: number[] = [];
  for (let column = 0; column < columns; column++) ring.push(column);
  for (let row = 1; row < rows; row++) ring.push(row * columns + columns - 1);
  for (let column = columns - 2; column >= 0; column--) ring.push((rows - 1) * columns + column);
  for (let row = rows - 2; row > 0; row--) ring.push(row * columns);
  return ring.flatMap((i) => {
    const place = grid.points[i];
    return place ? [{ lat_deg: place[0]!, lon_deg: place[1]! }] : [];
  });
}

/** The grid moved over the ground by degrees, as a whole. */
export function shifted(grid: Footprint, lat_deg: number, lon_deg: number): Footprint {
  if (lat_deg === 0 && lon_deg === 0) return grid;
  return { ...grid, points: grid.points.map((place) => place && [place[0]! + lat_deg, place[1]! + lon_deg]) };
}
