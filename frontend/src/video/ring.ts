/** The last minute of encoded pictures, so that an operator can go back. Bounded in time and bytes. Pure. */

import type { EncodedPicture } from '../source/source';

export interface RingBounds {
  keep_us: number;
  most_bytes: number;
}

export class PictureRing {
  private pictures: EncodedPicture[] = [];
  private bytes = 0;

  constructor(private readonly bounds: RingBounds = { keep_us: 60_000_000, most_bytes: 160_000_000 }) {}

  get length(): number {
    return this.pictures.length;
  }

  get first(): EncodedPicture | undefined {
    return this.pictures[0];
  }

  get last(): EncodedPicture | undefined {
    return this.pictures[this.pictures.length - 1];
  }

  clear(): void {
    this.pictures = [];
    this.bytes = 0;
  }

  /** The oldest picture is always a key frame, so that everything in the ring can be decoded. */
  push(picture: EncodedPicture): void {
    if (this.pictures.length === 0 && !picture.header.key) return;
    this.pictures.push(picture);
    this.bytes += picture.payload.byteLength;
    this.evict(picture.header.t_wire_unix_us - this.bounds.keep_us);
  }

  /** Whole groups go, never a key frame alone; the newest group stays in any case. */
  private evict(oldest_us: number): void {
    for (;;) {
      const next = this.pictures.findIndex((picture, i) => i > 0 && picture.header.key);
      if (next < 0) return;
      const stale = this.pictures[next]!.header.t_wire_unix_us <= oldest_us;
      if (!stale && this.bytes <= this.bounds.most_bytes) return;
      for (const gone of this.pictures.splice(0, next)) this.bytes -= gone.payload.byteLength;
    }
  }

  get(frame_id: number): EncodedPicture | undefined {
    return this.pictures[this.indexOf(frame_id)];
  }

  /** From the key frame before a picture up to it; empty when the picture is gone. */
  groupUpTo(frame_id: number): EncodedPicture[] {
    const end = this.indexOf(frame_id);
    if (end < 0) return [];
    let start = end;
    while (start > 0 && !this.pictures[start]!.header.key) start--;
    return this.pictures.slice(start, end + 1);
  }

  /** The picture `by` places after (or before) another, held at both ends. */
  neighbour(frame_id: number, by: number): EncodedPicture | undefined {
    const at = this.indexOf(frame_id);
    if (at < 0) return by < 0 ? this.first : this.last;
    return this.pictures[Math.max(0, Math.min(this.pictures.length - 1, at + by))];
  }

  /** The newest picture received at or before a time; the oldest when there is none. */
  before(t_wire_unix_us: number): EncodedPicture | undefined {
    let low = 0;
    let high = this.pictures.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.pictures[middle]!.header.t_wire_unix_us <= t_wire_unix_us) low = middle + 1;
      else high = middle;
    }
    return this.pictures[Math.max(0, low - 1)];
  }

  /** The picture taken nearest to a time; none where that is farther than `within_us`. */
  taken(t_unix_us: number, within_us: number): EncodedPicture | undefined {
    let best: EncodedPicture | undefined;
    let least_us = within_us;
    // Exposures may go back a little where the clock of the video is being found: no bisection.
    for (const picture of this.pictures) {
      const off_us = Math.abs(picture.header.t_unix_us - t_unix_us);
      if (off_us <= least_us) [best, least_us] = [picture, off_us];
    }
    return best;
  }

  private indexOf(frame_id: number): number {
    let low = 0;
    let high = this.pictures.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.pictures[middle]!.header.frame_id < frame_id) low = middle + 1;
      else high = middle;
    }
    return this.pictures[low]?.header.frame_id === frame_id ? low : -1;
  }
}
