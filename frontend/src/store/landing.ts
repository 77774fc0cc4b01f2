/** What is said and drawn of a landing. Pure. */

import type { FrameHeader, Landing, LandingMessage, PadSeen } from '../api/types';
import { formatAge, formatNumber } from '../geo/format';
import { formatLength, METRIC, type Units } from '../geo/units';
import type { Words } from './words';

/** The pad's outlines in the pixels of a shown picture. */
export interface PadMark {
  outlines: [number, number][][];
  /** Whether it was found in this very picture; else it is where the estimate has it. */
  exact: boolean;
}

/** A minute and a half at ten a second: as long as the page can go back in the video. */
const KEPT = 900;
/** At landing speeds the pad moves little in the picture within this time. */
const SAME_TIME_US = 150_000;

/** Where the pad was found, picture by picture, for the mark over the video. */
export class PadOutlines {
  private readonly of = new Map<string, PadSeen[]>();
  private readonly newest = new Map<string, LandingMessage>();

  /** Whether there is anything new. */
  take(message: LandingMessage): boolean {
    const { vehicle_id, seen } = message;
    this.newest.set(vehicle_id, message);
    if (!seen) return false;
    const known = this.of.get(vehicle_id) ?? [];
    const newest = known[known.length - 1];
    if (newest?.frame_id === seen.frame_id) return true;
    // Pictures are numbered anew when the station starts.
    const kept = newest && seen.t_frame_unix_us < newest.t_frame_unix_us ? [] : known.slice(-KEPT + 1);
    this.of.set(vehicle_id, [...kept, seen]);
    return true;
  }

  /** Where the pad was found in the shown picture, or by the estimate is at its time, scaled to its size. */
  at(vehicle_id: string, shown: Pick<FrameHeader, 'frame_id' | 't_unix_us'>, size: { width: number; height: number }): PadMark | null {
    const known = this.of.get(vehicle_id) ?? [];
    const found = known.findLast((one) => one.frame_id === shown.frame_id);
    const now = this.newest.get(vehicle_id);
    // Pictures are looked at a moment later than they are shown: meanwhile the estimate says where the pad is.
    const seen = found ?? now?.seen;
    const near = now !== undefined && Math.abs((now.t_state_unix_us ?? NaN) - shown.t_unix_us) <= SAME_TIME_US;
    const outlines = found?.outlines_px ?? (near ? now.outlines_px : null);
    if (!outlines || !seen) return null;
    const [across, down] = [size.width / seen.width_px, size.height / seen.height_px];
    return {
      // Pixel (0, 0) is the centre of the top-left pixel.
      outlines: outlines.map((points) => points.map(([u, v]) => [(u + 0.5) * across - 0.5, (v + 0.5) * down - 0.5])),
      exact: found !== undefined,
    };
  }
}

/** How the place over the pad is known. */
export function padWords(landing: Landing | null): Words {
  if (!landing?.pad) return { text: 'NO PAD', detail: 'Give the description that "pilotage pad" wrote with the print.', tone: 'none' };
  const why = landing.reason ? ` ${sentence(landing.reason)}` : '';
  switch (landing.mode) {
    case 'tracking':
      return { text: 'TRACKING', detail: landing.reason ? `The newest picture was not used:${why}` : 'The pad is in the picture.', tone: 'good' };
    case 'dead_reckoning':
      return { text: landing.coast_left_s === null ? 'DEAD RECKONING' : `DEAD RECKONING ${formatNumber(landing.coast_left_s, 1)} s left`, detail: `The pad was last seen ${formatAge(landing.age_s)} ago.${why}`, tone: 'watch' };
    case 'lost':
      return { text: 'LOST', detail: `The pad was last seen ${formatAge(landing.age_s)} ago, too long to land by.${why}`, tone: 'bad' };
    case 'searching':
      return { text: 'SEARCHING', detail: `No picture has shown the pad yet.${why}`, tone: 'watch' };
    default:
      return { text: 'WAITING', detail: 'The estimator has not said anything of the pad yet.', tone: 'none' };
  }
}

const PHASES: Record<NonNullable<Landing['descent']>['phase'], string> = {
  approach: 'OVER TO THE PAD',
  descend: 'DESCENDING',
  touchdown: 'TOUCHING DOWN',
  landed: 'LANDED',
  abort: 'LANDING ENDED',
  hold: 'HOLDING BY VISION',
};

/** How far the station's landing is, or how the last one ended; null where there was none. */
export function descentWords(descent: Landing['descent']): Words | null {
  if (!descent) return null;
  const detail = descent.reason ? sentence(descent.reason) : '';
  const ended = descent.phase === 'landed' ? 'good' : 'bad';
  return { text: PHASES[descent.phase], detail, tone: descent.active ? (detail || descent.phase === 'hold' ? 'watch' : 'good') : ended };
}

/** Whether the autopilot is told, and else why not. */
export function aidingWords(landing: Landing | null): Words {
  const aiding = landing?.aiding;
  if (!aiding?.on) return { text: 'off', detail: 'The autopilot is told nothing of the pad.', tone: 'none' };
  const form = aiding.form === 'local' ? 'in its own local frame (PX4)' : 'from its body (ArduPilot)';
  if (!aiding.sending) return { text: 'waiting', detail: `Nothing is sent: ${aiding.reason || 'no state yet'}.`, tone: 'watch' };
  return { text: `sending · ${formatNumber(aiding.sent)}`, detail: `LANDING_TARGET ${form}, with every state.`, tone: 'good' };
}

/** "0.42 m ahead, 0.10 m left": where to move, as the vehicle heads. */
export function moveWords({ ahead_m, right_m }: Pick<Landing, 'ahead_m' | 'right_m'>, units: Units = METRIC): string {
  if (ahead_m === null || right_m === null) return '–';
  const along = `${formatLength(Math.abs(ahead_m), units, 2)} ${ahead_m < 0 ? 'back' : 'ahead'}`;
  return `${along}, ${formatLength(Math.abs(right_m), units, 2)} ${right_m < 0 ? 'left' : 'right'}`;
}

/** Where the two parts of `moveWords` are wanted one by one. */
export function moveParts(landing: Pick<Landing, 'ahead_m' | 'right_m'>, units: Units = METRIC): string[] {
  return moveWords(landing, units).split(', ');
}

export interface TapeMark {
  /** Downwards from the tape's middle, in its units of drawing. */
  y: number;
  label: string | null;
}

/** Marks of a vertical tape whose middle shows `value`, every `step`, one unit `scale` long, as far as `reach`. */
export function tapeMarks(value: number, step: number, scale: number, reach: number, labelled = 2): TapeMark[] {
  const marks: TapeMark[] = [];
  const digits = step * labelled < 1 ? 1 : 0;
  for (let n = Math.ceil((value - reach / scale) / step); n * step <= value + reach / scale + 1e-9; n += 1) {
    marks.push({ y: (value - n * step) * scale, label: n % labelled === 0 ? formatNumber(n * step, digits) : null });
  }
  return marks;
}

/** Step between marks so that a tape stays readable from 30 m to the ground. */
export function heightStep(height_m: number): number {
  return height_m > 10 ? 1 : height_m > 3 ? 0.5 : 0.1;
}

export interface Cross {
  x: number;
  y: number;
  /** It lies beyond the edge, and is drawn on it. */
  outside: boolean;
}

/** Where the vehicle is over the pad in a view `side_m` wide, x to the right and y down as drawn. */
export function crossAt({ x_m, y_m }: Pick<Landing, 'x_m' | 'y_m'>, side_m: number): Cross | null {
  if (x_m === null || y_m === null) return null;
  const most = 0.47 * side_m;
  const factor = Math.min(1, most / Math.max(Math.abs(x_m), Math.abs(y_m), 1e-9));
  return { x: y_m * factor, y: -x_m * factor, outside: factor < 1 };
}

export function sentence(reason: string): string {
  const text = reason.trim();
  return text.charAt(0).toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? '' : '.');
}
