/** A read-only window for end-to-end tests and for a curious operator. */

import type { VideoPlayer } from '../video/player';
import type { Session } from './session.svelte';

export interface PilotageDebug {
  readonly framesDrawn: number;
  readonly framesDropped: number;
  readonly decodeFailures: number;
  readonly lastFrameId: number | null;
  readonly paused: boolean;
  readonly decoder: 'webcodecs' | 'jpeg' | null;
  /** From the frame's first byte at the station to its drawing here, milliseconds. */
  readonly drawLatencyMs: { count: number; median: number | null; p95: number | null };
  readonly receiveLatencyMs: { count: number; median: number | null; p95: number | null };
  readonly decodeLatencyMs: { count: number; median: number | null; p95: number | null };
  readonly trackLengths: { gps: number; vision: number };
  readonly connection: string;
}

declare global {
  interface Window {
    pilotageDebug?: PilotageDebug;
  }
}

export function exposeDebug(player: VideoPlayer, session: Session): () => void {
  const debug: PilotageDebug = {
    get framesDrawn() {
      return player.stats.drawn;
    },
    get framesDropped() {
      return player.stats.dropped;
    },
    get decodeFailures() {
      return player.stats.decode_failures;
    },
    get lastFrameId() {
      return player.view.shown?.frame_id ?? null;
    },
    get paused() {
      return player.view.paused;
    },
    get decoder() {
      return player.stats.kind;
    },
    get drawLatencyMs() {
      return player.stats.wire_to_drawn_ms;
    },
    get receiveLatencyMs() {
      return player.stats.wire_to_received_ms;
    },
    get decodeLatencyMs() {
      return player.stats.received_to_decoded_ms;
    },
    get trackLengths() {
      const id = session.selectedVehicle;
      if (id === null) return { gps: 0, vision: 0 };
      const { gps, vision } = session.tracks.of(id);
      return { gps: gps.length, vision: vision.length };
    },
    get connection() {
      return session.connection.phase;
    },
  };
  window.pilotageDebug = Object.freeze(debug);
  return () => {
    delete window.pilotageDebug;
  };
}
