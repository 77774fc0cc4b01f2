/** The one place where longitude comes first (RFC 7946, section 3.1.1). Pure. */

import type { LatLon } from './earth';

export type Position = [lon_deg: number, lat_deg: number];

export interface Feature<G, P = Record<string, unknown>> {
  type: 'Feature';
  id?: string;
  geometry: G;
  properties: P;
}

export interface PointGeometry {
  type: 'Point';
  coordinates: Position;
}

export interface LineGeometry {
  type: 'LineString';
  coordinates: Position[];
}

export interface PolygonGeometry {
  type: 'Polygon';
  coordinates: Position[][];
}

export interface Collection<G = PointGeometry | LineGeometry | PolygonGeometry, P = Record<string, unknown>> {
  type: 'FeatureCollection';
  features: Feature<G, P>[];
}

export function position(at: LatLon): Position {
  return [at.lon_deg, at.lat_deg];
}

export function latLon(coordinates: readonly number[]): LatLon {
  return { lon_deg: coordinates[0] ?? NaN, lat_deg: coordinates[1] ?? NaN };
}

export function collection<G, P>(features: Feature<G, P>[]): Collection<G, P> {
  return { type: 'FeatureCollection', features };
}

export function point<P>(at: LatLon, properties: P, id?: string): Feature<PointGeometry, P> {
  const feature: Feature<PointGeometry, P> = {
    type: 'Feature',
    geometry: { type: 'Point', coordinates: position(at) },
    properties,
  };
  return id === undefined ? feature : { ...feature, id };
}

export function line<P>(points: readonly LatLon[], properties: P): Feature<LineGeometry, P> {
  return {
    type: 'Feature',
    geometry: { type: 'LineString', coordinates: points.map(position) },
    properties,
  };
}

/** The ring is closed if it is not. */
export function polygon<P>(ring: readonly LatLon[], properties: P): Feature<PolygonGeometry, P> {
  const positions = ring.map(position);
  const first = positions[0];
  const last = positions[positions.length - 1];
  if (first && last && (first[0] !== last[0] || first[1] !== last[1])) positions.push(first);
  return { type: 'Feature', geometry: { type: 'Polygon', coordinates: [positions] }, properties };
}
