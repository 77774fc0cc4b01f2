/** Where each vehicle has been, by GPS and by vision. Bounded; cleared when a new epoch begins. */

import type { StationMessage, TrackCollection } from '../api/types';
import { distanceM, type LatLon } from '../geo/earth';
import { latLon } from '../geo/geojson';
import { stateTime_us } from './history';

const SHORTEST_STEP_M = 0.4;
const GAP_US = 3_000_000;
const LONGEST_JUMP_M = 60;
const POINTS_KEPT = 20_000;

export interface TrackPoint extends LatLon {
  t_unix_us: number;
}

/** A line in pieces: it breaks where nothing was known for a while or the position jumped. */
export class Track {
  private points: TrackPoint[] = [];
  private breaks = new Set<number>();
  private newest_us = -Infinity;
  /** Goes up with every change, so that a map need not compare. */
  revision = 0;

  get length(): number {
    return this.points.length;
  }

  get last(): TrackPoint | undefined {
    return this.points[this.points.length - 1];
  }

  clear(): void {
    this.points = [];
    this.breaks.clear();
    this.newest_us = -Infinity;
    this.revision++;
  }

  append(point: TrackPoint): void {
    const { last } = this;
    const gap = last !== undefined && point.t_unix_us - this.newest_us > GAP_US;
    this.newest_us = point.t_unix_us;
    if (last !== undefined) {
      const step_m = distanceM(last, point);
      if (step_m < SHORTEST_STEP_M && !gap) return;
      if (gap || step_m > LONGEST_JUMP_M) this.breaks.add(point.t_unix_us);
    }
    this.points.push(point);
    if (this.points.length > POINTS_KEPT) this.thin();
    this.revision++;
  }

  /** Put what the station remembers in front of what was heard since. */
  prime(older: TrackPoint[]): void {
    const first_us = this.points[0]?.t_unix_us ?? Infinity;
    const heard = this.points;
    const newest_us = this.newest_us;
    this.points = [];
    this.breaks.clear();
    this.newest_us = -Infinity;
    for (const point of older) if (point.t_unix_us < first_us) this.append(point);
    for (const point of heard) this.append(point);
    this.newest_us = Math.max(this.newest_us, newest_us);
    this.revision++;
  }

  pieces(): TrackPoint[][] {
    const pieces: TrackPoint[][] = [];
    let piece: TrackPoint[] = [];
    for (const point of this.points) {
      if (this.breaks.has(point.t_unix_us) && piece.length > 0) {
        pieces.push(piece);
        piece = [];
      }
      piece.push(point);
    }
    if (piece.length > 0) pieces.push(piece);
    return pieces;
  }

  /** Drop every second point of the older half: old parts get coarser, nothing disappears. */
  private thin(): void {
    const half = this.points.length >> 1;
    this.points = this.points.filter((point, i) => i >= half || i % 2 === 0 || this.breaks.has(point.t_unix_us));
  }
}

export interface VehicleTracks {
  gps: Track;
  vision: Track;
}

export class TrackBook {
  private readonly vehicles = new Map<string, VehicleTracks & { epoch: number | null }>();

  of(vehicle_id: string): VehicleTracks {
    return this.entry(vehicle_id);
  }

  private entry(vehicle_id: string): VehicleTracks & { epoch: number | null } {
    let entry = this.vehicles.get(vehicle_id);
    if (!entry) {
      entry = { gps: new Track(), vision: new Track(), epoch: null };
      this.vehicles.set(vehicle_id, entry);
    }
    return entry;
  }

  /** Returns the vehicle whose trails were cleared by a new epoch, if one was. */
  apply(message: StationMessage): string | null {
    // After an interruption the station remembers more than this page heard: begin again and let it prime.
    if (message.type === 'hello') this.vehicles.clear();
    if (message.type !== 'state' && message.type !== 'gps') return null;
    const entry = this.entry(message.vehicle_id);
    let cleared: string | null = null;
    if (message.type === 'state') {
      if (entry.epoch !== null && entry.epoch !== message.epoch) {
        entry.gps.clear();
        entry.vision.clear();
        cleared = message.vehicle_id;
      }
      entry.epoch = message.epoch;
    }
    const { lat_deg, lon_deg } = message;
    const t_unix_us = message.type === 'state' ? stateTime_us(message) : (message.t_gps_unix_us ?? message.t_unix_us);
    if (lat_deg === null || lon_deg === null || (message.type === 'gps' && message.fix_type < 2)) return cleared;
    (message.type === 'gps' ? entry.gps : entry.vision).append({ lat_deg, lon_deg, t_unix_us });
    return cleared;
  }

  prime(vehicle_id: string, source: 'gps' | 'vision', tracks: TrackCollection): void {
    const older: TrackPoint[] = [];
    const epoch = this.entry(vehicle_id).epoch ?? tracks.features[tracks.features.length - 1]?.properties.epoch;
    for (const feature of tracks.features) {
      if (feature.properties.epoch !== epoch) continue;
      const times = feature.properties.times_unix_us;
      feature.geometry.coordinates.forEach((coordinates, i) => {
        older.push({ ...latLon(coordinates), t_unix_us: times[i] ?? 0 });
      });
    }
    this.entry(vehicle_id)[source].prime(older);
  }
}
