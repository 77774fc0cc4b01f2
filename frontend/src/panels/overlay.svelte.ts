/** The video laid on the map where the estimate says that it lies. */

import type { StationApi } from '../api/client';
import type { Footprint, Pointing } from '../api/types';
import { metresPerDegree, offsetBetween, type LatLon } from '../geo/earth';
import { shifted } from '../map/drape';
import { LatestOnly } from '../video/latest';

/** Twice a second: an operator compares, and the station has other things to do. */
const SHORTEST_MS = 500;

export interface LaidFrame {
  vehicle_id: string;
  picture: HTMLCanvasElement;
  grid: Footprint;
}

/** What is drawn of a video at a moment. */
export interface DrawnFrame {
  vehicle_id: string;
  frame_id: number;
  canvas: HTMLCanvasElement;
}

export class MatchOverlay {
  on = $state(false);
  opacity = $state(0.7);
  laid = $state.raw<LaidFrame | null>(null);
  refusal = $state<string | null>(null);
  /** The frame is held and dragged to where it belongs. */
  adjusting = $state(false);
  shift = $state.raw({ north_m: 0, east_m: 0 });
  /** How well the operator can see where it belongs: one sigma on each axis. */
  std_m = $state(3);
  private readonly latest: LatestOnly<LaidFrame>;
  private asked: string | null = null;

  constructor(private readonly api: StationApi) {
    this.latest = new LatestOnly<LaidFrame>(SHORTEST_MS, (laid, error) => {
      if (this.adjusting) return;
      this.laid = laid;
      this.refusal = error === null ? null : error instanceof Error ? error.message : String(error);
      // What was refused may be known by now.
      if (error !== null) this.asked = null;
    });
  }

  /** Asks where the frame lies that is drawn when the question's turn comes; a paused one is asked for once. */
  offer(drawn: () => DrawnFrame | null, pointing: Pointing): void {
    this.latest.ask(() => {
      const frame = this.adjusting ? null : drawn();
      if (!frame) return null;
      const key = `${frame.vehicle_id}/${frame.frame_id}/${pointing.ground}/${pointing.height_above_ground_m}`;
      if (key === this.asked) return null;
      this.asked = key;
      const picture = document.createElement('canvas');
      picture.width = frame.canvas.width;
      picture.height = frame.canvas.height;
      picture.getContext('2d')?.drawImage(frame.canvas, 0, 0);
      const { vehicle_id } = frame;
      return this.api.footprint(vehicle_id, frame.frame_id, pointing).then((grid) => ({ vehicle_id, picture, grid }));
    });
  }

  /** The frame where it is drawn: with the drag of an adjustment. */
  get drawn(): LaidFrame | null {
    const { laid, shift } = this;
    const near = laid?.grid.points.find((place) => place !== null);
    if (!laid || !near) return laid;
    const scale = metresPerDegree(near[0]!);
    return { ...laid, grid: shifted(laid.grid, shift.north_m / scale.north_m, shift.east_m / scale.east_m) };
  }

  adjust(on: boolean): void {
    this.adjusting = on && this.laid !== null;
    this.shift = { north_m: 0, east_m: 0 };
    this.asked = null;
  }

  moveBy(north_m: number, east_m: number): void {
    if (this.adjusting) this.shift = { north_m: this.shift.north_m + north_m, east_m: this.shift.east_m + east_m };
  }

  drag(from: LatLon, to: LatLon): void {
    const { north_m, east_m } = offsetBetween(from, to);
    this.moveBy(north_m, east_m);
  }

  /** Hands the drag to the estimator; what it makes of it comes as a fix. */
  async align(): Promise<void> {
    if (!this.adjusting || !this.laid) return;
    const { vehicle_id, grid } = this.laid;
    await this.api.align(vehicle_id, { frame_id: grid.frame_id, ...this.shift, std_m: this.std_m });
    this.adjust(false);
  }

  toggle(): void {
    this.on = !this.on;
    if (!this.on) this.clear();
  }

  clear(): void {
    this.latest.cancel();
    this.asked = null;
    this.laid = null;
    this.refusal = null;
    this.adjust(false);
  }
}
