/** Alarms as an operator works through them: ranked, with what they mean and what to do. Pure. */

import type { Severity } from '../api/types';
import type { AlarmEntry } from './mission';

export interface AlarmAdvice {
  means: string;
  act: string;
}

/** In the words of docs/howto/alarms.md, shortened; a test holds the codes of both together. */
export const ADVICE: Readonly<Record<string, AlarmAdvice>> = {
  link_lost: { means: 'No heartbeat of the vehicle: the position shown is old.', act: 'Check radio, cable and port.' },
  gps_lost: { means: 'The receiver has no fix, or has fallen silent.', act: 'Fly by vision; watch the ellipse.' },
  video_stopped: { means: 'No pictures come.', act: 'Check camera, encoder and link.' },
  video_frozen: { means: 'It is always the same picture; none of them is used.', act: 'Check camera and encoder.' },
  video_size: { means: "Pictures have another shape than the camera file's.", act: 'Give the camera file of this camera and mode.' },
  no_texture: {
    means: 'Pictures show too little to navigate by; the ellipse grows.',
    act: 'Climb, descend or turn away; it ends by itself.',
  },
  map_mismatch: {
    means: 'The map does not show this ground, or the position is wrong; no fix is accepted.',
    act: "With GPS check the map's place and date, and the camera file. Without, take the position as dead reckoning.",
  },
  map_offset: {
    means: 'Map and GPS disagree by a steady distance, or map and estimate without GPS.',
    act: 'Give map.offset_ne_m, if the displacement is known; else mistrust GPS.',
  },
  barometer_drift: {
    means: "The barometer's zero moves; the pictures hold the height.",
    act: "Check the static port; mistrust the autopilot's heights.",
  },
  dead_reckoning: { means: 'No position fix for six seconds; the error grows.', act: 'Fly to ground with more to see.' },
  navigator_lost: { means: 'The estimator does not know where it is.', act: 'Fly to ground with more to see, or give GPS back.' },
  navigator_failed: { means: 'The estimator broke and starts anew.', act: 'Wait for it; report it with its text.' },
  disk_low: { means: 'The data folder is nearly full.', act: 'Delete flights.' },
  recording_failed: { means: 'The recording has holes.', act: 'Delete flights to make room; record anew.' },
};

const GRAVITY: Record<Severity, number> = { warning: 2, caution: 1, info: 0 };

/** How bad, in one phrase. */
export const GRAVITY_WORDS: Record<Severity, string> = { warning: 'act now', caution: 'watch it', info: 'to know' };

function order(alarm: AlarmEntry, acknowledged: ReadonlySet<string>): number {
  if (!alarm.active) return 2;
  return acknowledged.has(alarm.id) ? 1 : 0;
}

/** What stands and is not acknowledged first, the gravest of it at the top; what is over last, the newest of it first. */
export function rankedAlarms(alarms: readonly AlarmEntry[], acknowledged: ReadonlySet<string>): AlarmEntry[] {
  return [...alarms].sort(
    (a, b) =>
      order(a, acknowledged) - order(b, acknowledged) ||
      (a.active ? GRAVITY[b.severity] - GRAVITY[a.severity] : 0) ||
      b.raised_unix_us - a.raised_unix_us ||
      (a.id < b.id ? -1 : 1),
  );
}

/** Those that ask for the operator, the gravest first. */
export function loudAlarms(alarms: readonly AlarmEntry[], acknowledged: ReadonlySet<string>): AlarmEntry[] {
  return rankedAlarms(alarms, acknowledged).filter((alarm) => alarm.active && !acknowledged.has(alarm.id));
}

/** Alarms that were not there before, those that are told once among them. */
export function newAlarms(before: readonly AlarmEntry[], after: readonly AlarmEntry[]): AlarmEntry[] {
  if (before === after) return [];
  const known = new Set(before.map((alarm) => alarm.id));
  return after.filter((alarm) => !known.has(alarm.id));
}

/** How it is read out: the gravity, then the station's words without what only the eye needs. */
export function spokenAlarm(alarm: Pick<AlarmEntry, 'severity' | 'text'>): string {
  return `${alarm.severity === 'info' ? '' : `${alarm.severity}: `}${alarm.text.replace(/\s+/g, ' ').trim()}`;
}
