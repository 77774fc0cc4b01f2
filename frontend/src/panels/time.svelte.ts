/** The time that is looked at: now, or a moment of the past that new data does not move. */

import type { ReplayMessage } from '../api/types';
import { liveView, flightView, viewOfWidth, viewWith, WINDOWS_S, type TimeView } from '../store/timeline';
import { BROWSER_TIMERS, LatestOnly, type Timers } from '../video/latest';
import type { PlayerView } from '../video/player';

const STORED_AS = 'pilotage.timeline';
const SHORTEST_SEEK_MS = 80;
/** A replay tells ten times a second where it is. */
const SAYS_WHERE_MS = 250;
const SECOND_US = 1e6;

/** What the video panel lends. */
export interface PictureDeck {
  /** The picture that is shown for a time, paused, as soon as it is decoded; null where none is held. */
  seekTime(t_unix_us: number): number | null;
  pause(): void;
  play(): void;
  step(by: number): void;
  readonly view: PlayerView;
}

/** What is known of the selected vehicle's time. */
export interface TimeSource {
  vehicle_id: string | null;
  first_us: number | null;
  last_us: number | null;
  replay: ReplayMessage | null;
}

export interface ReplayControl {
  seek(vehicle_id: string, t_us: number): Promise<void>;
  pause(vehicle_id: string, paused: boolean): Promise<void>;
}

function storedWindow_us(): number {
  try {
    const stored = Number(localStorage.getItem(STORED_AS));
    if (WINDOWS_S.some((window_s) => window_s * SECOND_US === stored)) return stored;
  } catch {
    // A browser without storage forgets, and that is all.
  }
  return 300 * SECOND_US;
}

export class TimeCursor {
  /** Null while live, and while a replay's own position is looked at. */
  at_us = $state<number | null>(null);
  window_us = $state(storedWindow_us());
  /** Whether the picture of that time is on screen. */
  pictureHeld = $state(true);
  /** Where a replay is being moved to, until it says that it is there. */
  seeking_us = $state<number | null>(null);
  /** Where the pointer is over the timeline. */
  pointer_us = $state<number | null>(null);
  private held = $state.raw<TimeView | null>(null);
  private deck: PictureDeck | null = null;
  private awaited: number | null = null;
  private shownId: number | null = null;
  private readonly seeks: LatestOnly<void>;

  constructor(
    private readonly source: () => TimeSource,
    private readonly replays: ReplayControl,
    timers: Timers = BROWSER_TIMERS,
  ) {
    let cancel = () => {};
    this.seeks = new LatestOnly<void>(
      SHORTEST_SEEK_MS,
      () => {
        cancel();
        cancel = timers.after(SAYS_WHERE_MS, () => (this.seeking_us = null));
      },
      timers,
    );
  }

  get past(): boolean {
    return this.at_us !== null;
  }

  /** Where the cursor is drawn; null before anything is known. */
  get shown_us(): number | null {
    const { replay, last_us } = this.source();
    return this.at_us ?? this.seeking_us ?? replay?.t_unix_us ?? last_us;
  }

  get behind_s(): number {
    const { replay, last_us } = this.source();
    const head_us = replay?.t_unix_us ?? last_us;
    return this.at_us === null || head_us === null ? 0 : Math.max(0, head_us - this.at_us) / SECOND_US;
  }

  view(): TimeView | null {
    if (this.held) return this.held;
    const { replay, last_us } = this.source();
    if (replay) return flightView(replay.start_unix_us, replay.end_unix_us, this.seeking_us ?? replay.t_unix_us, this.window_us);
    return last_us === null ? null : liveView(last_us, this.window_us);
  }

  setWindow(window_us: number): void {
    const { at_us } = this;
    if (this.held && at_us !== null) this.held = viewOfWidth(this.held, at_us, window_us);
    this.window_us = window_us;
    try {
      localStorage.setItem(STORED_AS, String(window_us));
    } catch {
      // As above.
    }
  }

  lend(deck: PictureDeck): () => void {
    this.deck = deck;
    return () => {
      if (this.deck === deck) this.deck = null;
    };
  }

  /** Look at a time. */
  scrub(t_us: number): void {
    const { replay, first_us, last_us, vehicle_id } = this.source();
    if (replay && vehicle_id !== null) {
      const wanted_us = Math.round(Math.min(Math.max(t_us, replay.start_unix_us), replay.end_unix_us));
      if (this.at_us !== null) this.release();
      this.seeking_us = wanted_us;
      this.seeks.ask(() => this.replays.seek(vehicle_id, wanted_us));
      return;
    }
    if (first_us === null || last_us === null) return;
    this.hold(Math.min(Math.max(t_us, first_us), last_us));
    const frame_id = this.deck?.seekTime(this.at_us!) ?? null;
    this.awaited = frame_id !== null && frame_id !== this.shownId ? frame_id : null;
    this.pictureHeld = frame_id !== null;
    if (frame_id === null) this.deck?.pause();
  }

  /** Hold what is on screen. */
  pause(): void {
    if (this.at_us !== null) return;
    const { last_us } = this.source();
    this.deck?.pause();
    const view = this.deck?.view;
    if (view?.paused && view.shown) {
      this.shownId = view.shown.frame_id;
      this.pictureHeld = true;
      this.hold(view.shown.t_unix_us);
    } else if (last_us !== null) {
      this.pictureHeld = false;
      this.hold(last_us);
    }
  }

  /** Back to now, or a replay goes on. */
  live(): void {
    const { replay, vehicle_id } = this.source();
    const wasPast = this.at_us !== null;
    this.release();
    this.deck?.play();
    if (replay && vehicle_id !== null && !wasPast && replay.paused) void this.replays.pause(vehicle_id, false);
  }

  toggle(): void {
    const { replay, vehicle_id } = this.source();
    if (this.at_us !== null) this.live();
    else if (replay && vehicle_id !== null) void this.replays.pause(vehicle_id, !replay.paused);
    else this.pause();
  }

  /** By pictures where they are held, else by seconds. */
  step(by: number): void {
    if (this.source().replay || !this.deck || (this.at_us !== null && !this.pictureHeld)) {
      this.stepSeconds(by);
      return;
    }
    this.pause();
    this.awaited = null;
    this.deck.step(by);
  }

  stepSeconds(by: number): void {
    const { shown_us } = this;
    if (shown_us !== null) this.scrub(shown_us + by * SECOND_US);
  }

  /** Another vehicle: what was looked at is not its past. */
  reset(): void {
    this.seeks.cancel();
    this.seeking_us = null;
    this.release();
  }

  /** The player says what is on screen. */
  playerChanged(view: PlayerView): void {
    const { replay } = this.source();
    if (!view.paused) {
      this.shownId = view.shown?.frame_id ?? null;
      if (this.at_us === null || !this.pictureHeld) return;
      // Its stream began anew under what is looked at: a replay was moved, or the camera came back.
      if (replay) this.release();
      else this.pictureHeld = false;
      return;
    }
    const { shown } = view;
    if (!shown || shown.frame_id === this.shownId) return;
    if (this.awaited !== null && shown.frame_id !== this.awaited) return;
    this.awaited = null;
    this.shownId = shown.frame_id;
    this.pictureHeld = true;
    this.hold(shown.t_unix_us);
  }

  private hold(t_us: number): void {
    const view = this.view();
    if (view) this.held = viewWith(view, t_us);
    this.at_us = t_us;
  }

  private release(): void {
    this.at_us = null;
    this.held = null;
    this.awaited = null;
    this.pictureHeld = true;
  }
}
