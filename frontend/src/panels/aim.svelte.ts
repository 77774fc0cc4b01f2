/** What the crosshair lies on: asked of the station while it moves, kept by nobody. */

import type { PixelOfFrame, StationApi } from '../api/client';
import type { LocatedPixel, Pointing } from '../api/types';
import { LatestOnly } from '../video/latest';

const SHORTEST_MS = 80;

export class Aim {
  pointing = $state.raw<Pointing>({ height_above_ground_m: 0, ground: 'terrain' });
  place = $state.raw<LocatedPixel | null>(null);
  /** Why there is no place, in the station's words. */
  refusal = $state<string | null>(null);
  private readonly latest: LatestOnly<LocatedPixel>;

  constructor(private readonly api: StationApi) {
    this.latest = new LatestOnly<LocatedPixel>(SHORTEST_MS, (place, error) => {
      this.place = place;
      this.refusal = error === null ? null : error instanceof Error ? error.message : String(error);
    });
  }

  /** `pixel` is asked for when its turn comes, so that a live picture is the newest then. */
  ask(vehicle_id: string, pixel: () => PixelOfFrame | null): void {
    this.latest.ask(() => {
      const at = pixel();
      return at && this.api.locate(vehicle_id, at, this.pointing);
    });
  }

  clear(): void {
    this.latest.cancel();
    this.place = null;
    this.refusal = null;
  }
}
