/** A plan and its path as GeoJSON. Pure. */

import type { PlanPath } from '../api/types';
import type { LatLon } from '../geo/earth';
import { ellipseRing } from '../geo/ellipse';
import {
  collection, latLon, line, point, polygon,
  type Collection, type Feature, type LineGeometry, type PointGeometry, type PolygonGeometry,
} from '../geo/geojson';
import { sameHandle, type Handle } from '../store/handles';
import { homeOf, pointsOf, rallyOf, zonesOf, type PlanDocument } from '../store/plan';

type Drawn = Feature<PointGeometry | LineGeometry | PolygonGeometry>;

/** From slow to fast; told apart by their lightness as well. */
export const SPEED_COLOURS = ['#5a3fa0', '#3f6fd0', '#2aa5b8', '#4ccf8a', '#b8e04a', '#fff14d'] as const;

/** Which colour a speed has on a scale that ends at `fastest_m_s`. */
export function speedStep(speed_m_s: number, fastest_m_s: number): number {
  const share = fastest_m_s > 0 ? speed_m_s / fastest_m_s : 0;
  return Math.min(SPEED_COLOURS.length - 1, Math.max(0, Math.floor(share * SPEED_COLOURS.length)));
}

export function fastestOf(path: PlanPath | null): number {
  return Math.max(0, ...(path?.properties.speed_m_s ?? []));
}

/** One line for each stretch of one colour, and a mark at each problem. */
export function pathFeatures(path: PlanPath | null): Collection {
  if (!path) return collection<PointGeometry, Record<string, unknown>>([]);
  const { speed_m_s, problems } = path.properties;
  const places = (path.geometry?.coordinates ?? []).map((at) => latLon(at as unknown as number[]));
  const fastest = fastestOf(path);
  const features: Drawn[] = [];
  let from = 0;
  const stepAt = (i: number) => speedStep(((speed_m_s[i] ?? 0) + (speed_m_s[i + 1] ?? 0)) / 2, fastest);
  for (let i = 1; i < places.length; i++) {
    if (i < places.length - 1 && stepAt(i) === stepAt(from)) continue;
    features.push(line(places.slice(from, i + 1), { kind: 'path', step: stepAt(from) }));
    from = i;
  }
  for (const { lat_deg, lon_deg, text } of problems) {
    if (lat_deg !== null && lon_deg !== null) features.push(point({ lat_deg, lon_deg }, { kind: 'problem', text }));
  }
  return collection(features);
}

export function planFeatures(
  plan: PlanDocument | null, draft: readonly LatLon[], selected: Handle | null, current: number | null, editable: boolean,
): Collection {
  const features: Drawn[] = [];
  if (plan) {
    for (const { kind, index, inclusion, ring, radius_m } of zonesOf(plan)) {
      const outline = radius_m === null ? ring : ellipseRing(ring[0]!, { semi_major_m: radius_m, semi_minor_m: radius_m, azimuth_deg: 0 });
      features.push(polygon(outline, { kind: 'zone', inclusion }));
      if (!editable) continue;
      ring.forEach((at, corner) => {
        const handle: Handle = kind === 'circle' ? { kind, index } : { kind, index, corner };
        features.push(point(at, { kind: 'corner', selected: sameHandle(handle, selected) }));
      });
    }
    const points = pointsOf(plan);
    if (points.length > 1) features.push(line(points.map(({ place }) => place), { kind: 'legs' }));
    const home = homeOf(plan);
    if (home) features.push(point(home, { kind: 'home', label: 'H', selected: selected?.kind === 'home' }));
    rallyOf(plan).forEach((at, index) => {
      features.push(point(at, { kind: 'rally', label: 'R', selected: sameHandle({ kind: 'rally', index }, selected) }));
    });
    for (const { index, number, place } of points) {
      const chosen = sameHandle({ kind: 'item', index }, selected);
      features.push(point(place, { kind: 'item', label: String(number), selected: chosen, current: number === current }));
    }
  }
  if (draft.length > 1) features.push(line(draft, { kind: 'draft' }));
  for (const at of draft) features.push(point(at, { kind: 'corner', selected: false }));
  return collection(features);
}
