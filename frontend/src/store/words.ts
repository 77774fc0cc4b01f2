/** What the status strip says, in plain words. Pure. */

import type { Mode, StateMessage, TargetTrack } from '../api/types';
import { formatAge, formatNumber, withUnit } from '../geo/format';
import { formatSpeed, METRIC, type Units } from '../geo/units';
import type { ConnectionStatus } from '../source/source';
import { isReplay, type Vehicle } from './mission';

/** Calm, to be watched, or to be acted on; grey when there is nothing to judge. */
export type Tone = 'good' | 'watch' | 'bad' | 'none';

export interface Words {
  text: string;
  detail: string;
  tone: Tone;
}

const MODE_WORDS: Record<Mode, string> = {
  gps: 'GPS',
  vision: 'VISION',
  dead_reckoning: 'DEAD RECKONING',
  lost: 'LOST',
};

export function modeWords(vehicle: Vehicle | null): Words {
  const state = vehicle?.state;
  const progress = vehicle?.replay?.progress;
  if (!state && progress !== null && progress !== undefined && progress < 1) {
    return {
      text: `ESTIMATING ${Math.floor(progress * 100)} %`,
      detail: 'The estimate of this flight is being computed; it is shown when it is done.',
      tone: 'none',
    };
  }
  if (!state) return { text: 'NO ESTIMATE', detail: 'The station has not estimated a position yet.', tone: 'none' };
  const age = formatAge(state.last_fix_age_s);
  const denied = state.gps_denied ? ' – GPS denied' : '';
  switch (state.mode) {
    case 'gps':
      return { text: 'GPS', detail: 'GPS is in use; vision runs beside it.', tone: 'good' };
    case 'vision':
      return {
        text: `VISION${denied || ' – no GPS'}`,
        detail: `Position from the video and the reference map. Last accepted fix ${age} ago.`,
        tone: 'good',
      };
    case 'dead_reckoning':
      return {
        text: `DEAD RECKONING${denied}`,
        detail: `No accepted fix for ${age}: the position drifts, and its ellipse grows.`,
        tone: 'watch',
      };
    case 'lost':
      return { text: `LOST${denied}`, detail: 'The position is not known well enough to be used.', tone: 'bad' };
    default:
      return { text: MODE_WORDS[state.mode] ?? String(state.mode).toUpperCase(), detail: '', tone: 'none' };
  }
}

/** How old the newest estimate may be before it must not look alive. */
export const STALE_AFTER_S = 2;

/** The mode, or that what is shown is old: a frozen page must not look like a hovering aircraft. */
export function freshModeWords(vehicle: Vehicle | null, heard_s: number | null, connected: boolean): Words & { stale: boolean } {
  const words = modeWords(vehicle);
  if (!vehicle?.state || vehicle.replay?.paused || vehicle.replay?.ended) return { ...words, stale: false };
  if (connected && (heard_s === null || heard_s < STALE_AFTER_S)) return { ...words, stale: false };
  return {
    text: `STALE ${formatAge(heard_s)}`,
    detail: `Nothing new for ${formatAge(heard_s)}. Before: ${words.text}.`,
    tone: 'bad',
    stale: true,
  };
}

export function linkWords(vehicle: Vehicle | null): Words {
  if (vehicle && isReplay(vehicle.id)) return { text: 'Replay', detail: 'Recorded telemetry', tone: 'good' };
  const link = vehicle?.link;
  if (!link) return { text: 'No link', detail: 'No telemetry has arrived.', tone: 'none' };
  const detail = [
    link.endpoint ?? '',
    withUnit((link.bytes_per_s ?? NaN) / 1000, 'kB/s', 1),
    `loss ${withUnit(link.loss_pct, '%', 1)}`,
    `noise ${withUnit(link.noise_bytes, 'B')}`,
    link.signed ? 'signed' : 'unsigned',
  ]
    .filter(Boolean)
    .join(' · ');
  if (!link.connected) return { text: `Lost ${formatAge(link.heartbeat_age_s)}`, detail, tone: 'bad' };
  const lossy = (link.loss_pct ?? 0) > 5 || (link.heartbeat_age_s ?? 0) > 2.5;
  const loss = (link.loss_pct ?? 0) >= 0.1 ? ` · ${formatNumber(link.loss_pct, 1)} % lost` : '';
  return { text: `${formatNumber(link.messages_per_s)} msg/s${loss}`, detail, tone: lossy ? 'watch' : 'good' };
}

export function videoWords(vehicle: Vehicle | null): Words {
  const video = vehicle?.video;
  if (!video || video.status === 'waiting') {
    return { text: 'Waiting', detail: video ? `${video.source}: no frame yet` : 'No video source yet', tone: 'none' };
  }
  const size = video.width && video.height ? `${video.width}×${video.height}` : '';
  const detail = [
    video.source,
    size,
    video.codec ?? '',
    `latency to the station ${withUnit(video.latency_ms, 'ms')}`,
    `${formatNumber(video.decode_errors)} decode errors`,
  ]
    .filter(Boolean)
    .join(' · ');
  const { replay } = vehicle!;
  if (video.status !== 'flowing' && (replay?.paused || replay?.ended)) {
    return { text: replay.ended ? `At the end ${size}` : `Paused ${size}`, detail, tone: 'none' };
  }
  switch (video.status) {
    case 'flowing':
      return { text: `${formatNumber(video.fps)} fps ${size}`, detail, tone: 'good' };
    case 'frozen':
      return { text: 'Frozen picture', detail, tone: 'bad' };
    case 'stopped':
      return { text: `Stopped ${formatAge(video.last_frame_age_s)}`, detail, tone: 'bad' };
    default:
      return { text: String(video.status), detail, tone: 'none' };
  }
}

/** What is added to the video's times, or that nobody knows it yet. Null where the station says nothing of it. */
export function videoClockWords(state: StateMessage | null): Words | null {
  const clock = state?.video_clock;
  if (!clock) return null;
  switch (clock.source) {
    case 'found':
      return {
        text: `${signed(clock.time_offset_s, 3)} ± ${formatNumber(clock.std_s, 3)} s`,
        detail: 'Found from how camera and gyroscopes turn; added to the times of the pictures. One standard deviation.',
        tone: 'good',
      };
    case 'stamped':
      return { text: "the vehicle's own", detail: 'Each picture carries the time of its exposure by the clock of the vehicle.', tone: 'good' };
    case 'given':
      return { text: `${signed(clock.time_offset_s, 3)} s, as configured`, detail: 'Given when the station was started; nobody checks it.', tone: 'none' };
    default:
      return {
        text: 'not known yet',
        detail: `Turns of the aircraft tell it${clock.reason ? `; so far: ${clock.reason}` : ''}. Pictures are held back for it, at most 20 s.`,
        tone: 'watch',
      };
  }
}

/** Above it an axis is not told: the filter begins at 0.6 degrees for a fixed camera, at 1.1 for one on a gimbal. */
const BORESIGHT_KNOWN_DEG = 0.4;

/** How far the camera looks beside its stated mount, axis by axis, as far as that is known. */
export function boresightWords(state: StateMessage | null): Words | null {
  const deg = state?.boresight_deg;
  const std = state?.boresight_std_deg;
  if (!deg || !std) return null;
  const known = deg.map((angle, axis) => angle !== null && (std[axis] ?? Infinity) <= BORESIGHT_KNOWN_DEG);
  const detail = `About x, y, z of the body (of the gimbal, where there is one): ${deg
    .map((angle, axis) => `${signed(angle, 2)} ± ${formatNumber(std[axis], 2)}°`)
    .join(', ')}. One standard deviation.`;
  if (!known.includes(true)) return { text: 'not known yet', detail, tone: 'none' };
  const worst = Math.max(...std.filter((_, axis) => known[axis]).map((value) => value ?? 0));
  const axes = deg.map((angle, axis) => (known[axis] ? signed(angle, 1) : '?')).join(' / ');
  return { text: `${axes} ° ± ${formatNumber(worst, 1)}`, detail, tone: known.includes(false) ? 'none' : 'good' };
}

function signed(value: number | null | undefined, digits: number): string {
  const text = formatNumber(value, digits);
  return typeof value === 'number' && value > 0 && Number(value.toFixed(digits)) !== 0 ? `+${text}` : text;
}

export function fixAgeTone(age_s: number | null | undefined): Tone {
  if (age_s === null || age_s === undefined) return 'none';
  return age_s < 3 ? 'good' : age_s < 15 ? 'watch' : 'bad';
}

export function connectionWords(status: ConnectionStatus): Words {
  switch (status.phase) {
    case 'open':
      return { text: 'Station', detail: 'Connected to the station', tone: 'good' };
    case 'connecting':
      return { text: 'Connecting…', detail: status.reason, tone: 'watch' };
    case 'retrying':
      return {
        text: `Station lost – retry in ${formatNumber((status.retry_in_ms ?? 0) / 1000, 1)} s`,
        detail: `${status.reason}; attempt ${status.attempt}`,
        tone: 'bad',
      };
    case 'closed':
      return { text: 'Disconnected', detail: status.reason, tone: 'bad' };
  }
}

const METHOD_WORDS: Record<string, string> = {
  ray_terrain: 'ray to terrain',
  ray_flat: 'ray to flat ground',
  manual: 'entered by hand',
  fused: 'ray and map match',
};

export function methodWords(method: string): string {
  return METHOD_WORDS[method] ?? method.replaceAll('_', ' ');
}

/** What following says of a target, in a few words. */
export function trackWords(track: TargetTrack, units: Units = METRIC): string {
  if (track.status === 'stopped') return track.reason ? `not followed: ${track.reason}` : 'not followed';
  if (track.status === 'lost') return `lost: ${track.reason ?? 'not seen'}`;
  if (track.speed_m_s !== null && track.course_deg !== null) {
    return `moving ${formatSpeed(track.speed_m_s, units, 1)}, ${formatNumber(track.course_deg)}°`;
  }
  return track.moving === false ? 'standing' : 'seen';
}

/** How the picture of a target fits the map, null where that says nothing to an operator. */
export function registrationWords(registration: string | null, refined: number): string | null {
  if (registration === 'waiting') return 'matching the map…';
  if (refined > 0) return refined > 1 ? `refined ${refined} times` : 'refined';
  return registration?.startsWith('no') ? registration : null;
}

export function vehicleWords(vehicle: Vehicle): string {
  if (isReplay(vehicle.id)) return `Replay ${vehicle.replay?.flight_id ?? vehicle.id.slice('replay-'.length)}`;
  const type = vehicle.telemetry?.vehicle_type ?? vehicle.summary?.vehicle_type ?? 'vehicle';
  const simulated = vehicle.telemetry?.simulated ?? vehicle.summary?.simulated ?? false;
  return `${vehicle.id} · ${String(type).replaceAll('_', ' ')}${simulated ? ' (sim)' : ''}`;
}
