/** What of a plan can be taken hold of on the map, and what dragging, inserting and deleting does to it. Pure. */

import type { LatLon } from '../geo/earth';
import {
  homeOf, insertCorner, insertPoint, moveCorner, movePoint, moveRally, pointsOf, rallyOf, removeCorner, removeItem, removeRally, removeZone,
  setHome, zonesOf, type PlanDocument,
} from './plan';

export type Handle =
  | { readonly kind: 'item'; readonly index: number }
  | { readonly kind: 'polygon'; readonly index: number; readonly corner: number }
  | { readonly kind: 'circle'; readonly index: number }
  | { readonly kind: 'rally'; readonly index: number }
  | { readonly kind: 'home' };

/** A leg or an edge, on which a click makes a new point. */
export type Edge =
  | { readonly kind: 'leg'; readonly index: number; readonly from: LatLon; readonly to: LatLon }
  | { readonly kind: 'edge'; readonly index: number; readonly corner: number; readonly from: LatLon; readonly to: LatLon };

export interface Placed {
  readonly handle: Handle;
  readonly at: LatLon;
}

export function sameHandle(a: Handle | null, b: Handle | null): boolean {
  return a !== null && b !== null && JSON.stringify(a) === JSON.stringify(b);
}

/** Those on top last. */
export function handlesOf(plan: PlanDocument): Placed[] {
  const placed: Placed[] = [];
  const home = homeOf(plan);
  if (home) placed.push({ handle: { kind: 'home' }, at: home });
  for (const { kind, index, ring } of zonesOf(plan)) {
    ring.forEach((at, corner) => placed.push({ handle: kind === 'circle' ? { kind, index } : { kind, index, corner }, at }));
  }
  rallyOf(plan).forEach((at, index) => placed.push({ handle: { kind: 'rally', index }, at }));
  for (const point of pointsOf(plan)) placed.push({ handle: { kind: 'item', index: point.index }, at: point.place });
  return placed;
}

export function edgesOf(plan: PlanDocument): Edge[] {
  const edges: Edge[] = [];
  for (const { kind, index, ring } of zonesOf(plan)) {
    if (kind !== 'polygon') continue;
    ring.forEach((from, i) => edges.push({ kind: 'edge', index, corner: i + 1, from, to: ring[(i + 1) % ring.length]! }));
  }
  const points = pointsOf(plan);
  points.slice(1).forEach((point, i) => edges.push({ kind: 'leg', index: point.index, from: points[i]!.place, to: point.place }));
  return edges;
}

export function moved(plan: PlanDocument, handle: Handle, at: LatLon): PlanDocument {
  switch (handle.kind) {
    case 'item':
      return movePoint(plan, handle.index, at);
    case 'polygon':
      return moveCorner(plan, 'polygon', handle.index, handle.corner, at);
    case 'circle':
      return moveCorner(plan, 'circle', handle.index, 0, at);
    case 'rally':
      return moveRally(plan, handle.index, at);
    case 'home':
      return setHome(plan, at);
  }
}

/** Home cannot be deleted: a plan has one. */
export function removed(plan: PlanDocument, handle: Handle): PlanDocument {
  switch (handle.kind) {
    case 'item':
      return removeItem(plan, handle.index);
    case 'polygon':
      return removeCorner(plan, handle.index, handle.corner);
    case 'circle':
      return removeZone(plan, 'circle', handle.index);
    case 'rally':
      return removeRally(plan, handle.index);
    case 'home':
      return plan;
  }
}

export function insertedAt(plan: PlanDocument, edge: Edge, at: LatLon): { plan: PlanDocument; handle: Handle } {
  if (edge.kind === 'leg') return { plan: insertPoint(plan, edge.index, at), handle: { kind: 'item', index: edge.index } };
  return { plan: insertCorner(plan, edge.index, edge.corner, at), handle: { kind: 'polygon', index: edge.index, corner: edge.corner } };
}

/** Distance of `p` from the segment `ab`, all in pixels. */
export function pixelsFrom(p: readonly number[], a: readonly number[], b: readonly number[]): number {
  const [dx, dy] = [b[0]! - a[0]!, b[1]! - a[1]!];
  const size = dx * dx + dy * dy;
  const along = size === 0 ? 0 : Math.min(1, Math.max(0, ((p[0]! - a[0]!) * dx + (p[1]! - a[1]!) * dy) / size));
  return Math.hypot(p[0]! - a[0]! - along * dx, p[1]! - a[1]! - along * dy);
}
