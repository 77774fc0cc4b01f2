/** What following says, picture by picture: where each target was, for its track and for the mark over the video. */

import type { SightingMessage, StationMessage, TrackCollection } from '../api/types';
import { latLon } from '../geo/geojson';
import { Track } from './tracks';

/** A minute and a half at five a second: as long as the page can go back in the video. */
const KEPT = 450;
const LONGEST_GAP_US = 500_000;
const LONGEST_AHEAD_US = 700_000;
const SAME_PICTURE_US = 20_000;

export interface Mark {
  u_px: number;
  v_px: number;
  size_px: number;
  /** Whether this very picture was looked at; else it is a guess from those beside it. */
  exact: boolean;
}

interface Seen {
  t_us: number;
  u_px: number;
  v_px: number;
  size_px: number;
}

/**
 * Where a target is in the picture of a time. The station looks at some pictures and answers a moment later, so
 * a live picture is ahead of the newest sighting: between two it is interpolated, after the last carried on for a moment.
 */
export function markAt(sightings: readonly SightingMessage[], t_us: number): Mark | null {
  let before: SightingMessage | null = null;
  let earlier: SightingMessage | null = null;
  let after: SightingMessage | null = null;
  for (const one of sightings) {
    if (one.t_frame_unix_us <= t_us + SAME_PICTURE_US) {
      earlier = before;
      before = one;
    } else {
      after = one;
      break;
    }
  }
  const last = before && seen(before);
  if (!last) return null;
  if (Math.abs(last.t_us - t_us) <= SAME_PICTURE_US) return { ...last, exact: true };
  // Not seen in the next one that was looked at: nothing is known in between.
  const other = after ? seen(after) : earlier && seen(earlier);
  if (!other || Math.abs(other.t_us - last.t_us) > LONGEST_GAP_US || t_us - last.t_us > LONGEST_AHEAD_US) return null;
  const part = (t_us - last.t_us) / (other.t_us - last.t_us);
  const between = (a: number, b: number) => a + part * (b - a);
  return { u_px: between(last.u_px, other.u_px), v_px: between(last.v_px, other.v_px), size_px: last.size_px, exact: false };
}

function seen(one: SightingMessage): Seen | null {
  const { u_px, v_px, size_px } = one;
  return u_px === null || v_px === null || size_px === null ? null : { t_us: one.t_frame_unix_us, u_px, v_px, size_px };
}

interface Entry {
  vehicle_id: string;
  sightings: SightingMessage[];
  track: Track;
}

export class SightingBook {
  private readonly entries = new Map<string, Entry>();

  /** Whether anything changed. */
  apply(message: StationMessage): boolean {
    if (message.type === 'target' && message.action === 'deleted') {
      return this.entries.delete(typeof message.target === 'string' ? message.target : message.target.id);
    }
    if (message.type !== 'sighting') return false;
    const entry = this.entry(message.target_id, message.vehicle_id);
    const newest = entry.sightings[entry.sightings.length - 1];
    // Followed once more from its picture on, it begins again.
    if (newest && message.t_frame_unix_us <= newest.t_frame_unix_us) {
      entry.sightings = [];
      entry.track.clear();
    }
    entry.sightings.push(message);
    if (entry.sightings.length > KEPT) entry.sightings.shift();
    const { lat_deg, lon_deg, track } = message;
    if (track.status === 'seen' && track.seen_unix_us !== null) entry.track.append({ lat_deg, lon_deg, t_unix_us: track.seen_unix_us });
    return true;
  }

  prime(target_id: string, collection: TrackCollection): void {
    const older = collection.features.flatMap(({ geometry, properties }) =>
      geometry.coordinates.map((at, i) => ({ ...latLon(at), t_unix_us: properties.times_unix_us[i] ?? 0 })),
    );
    if (older.length > 0) this.entry(target_id, collection.features[0]!.properties.vehicle_id).track.prime(older);
  }

  trackOf(target_id: string): Track | null {
    return this.entries.get(target_id)?.track ?? null;
  }

  /** The marks over a vehicle's picture, by target. */
  marksAt(vehicle_id: string, t_us: number): { id: string; mark: Mark }[] {
    const marks: { id: string; mark: Mark }[] = [];
    for (const [id, entry] of this.entries) {
      const mark = entry.vehicle_id === vehicle_id ? markAt(entry.sightings, t_us) : null;
      if (mark) marks.push({ id, mark });
    }
    return marks;
  }

  private entry(target_id: string, vehicle_id: string): Entry {
    let entry = this.entries.get(target_id);
    if (!entry) {
      entry = { vehicle_id, sightings: [], track: new Track() };
      this.entries.set(target_id, entry);
    }
    return entry;
  }
}
