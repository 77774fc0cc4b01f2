/** What a window of time shows: bands of modes, attempts at fixes, marks, ticks; and how a window moves. Pure. */

import type { Mode, Target } from '../api/types';
import { formatNumber } from '../geo/format';
import type { TimeMark } from './events';
import { MODES, type VehicleSeries } from './series';

export const WINDOWS_S = [60, 300, 900, 3600] as const;
/** A state stands for this long; longer silence is a hole in the band. */
const HOLD_US = 3_000_000;

export const MODE_WORDS: Record<Mode, string> = {
  gps: 'GPS',
  vision: 'vision',
  dead_reckoning: 'dead reckoning',
  lost: 'lost',
};

export interface TimeView {
  from_us: number;
  to_us: number;
}

/** The newest at the right edge, with a little room. */
export function liveView(head_us: number, window_us: number): TimeView {
  return { from_us: head_us - 0.99 * window_us, to_us: head_us + 0.01 * window_us };
}

/** Page by page through a flight, so that nothing creeps; the whole flight where it is shorter than the window. */
export function flightView(start_us: number, end_us: number, at_us: number, window_us: number): TimeView {
  if (end_us - start_us <= window_us) return { from_us: start_us, to_us: Math.max(end_us, start_us + 1) };
  const page = Math.floor((Math.min(at_us, end_us - 1) - start_us) / window_us);
  const from_us = Math.min(start_us + Math.max(0, page) * window_us, end_us - window_us);
  return { from_us, to_us: from_us + window_us };
}

/** The view itself where it holds a time, else moved by just so much. */
export function viewWith(view: TimeView, at_us: number): TimeView {
  const by_us = at_us < view.from_us ? at_us - view.from_us : at_us > view.to_us ? at_us - view.to_us : 0;
  return by_us === 0 ? view : { from_us: view.from_us + by_us, to_us: view.to_us + by_us };
}

/** Another width about the same place of the same time. */
export function viewOfWidth(view: TimeView, at_us: number, window_us: number): TimeView {
  const part = Math.min(1, Math.max(0, (at_us - view.from_us) / (view.to_us - view.from_us)));
  const from_us = at_us - part * window_us;
  return { from_us, to_us: from_us + window_us };
}

export function partOf(view: TimeView, t_us: number): number {
  return (t_us - view.from_us) / (view.to_us - view.from_us);
}

export function timeAt(view: TimeView, part: number): number {
  return Math.round(view.from_us + part * (view.to_us - view.from_us));
}

export interface Band extends TimeView {
  mode: Mode;
  gps_denied: boolean;
}

export function bandsIn({ states }: VehicleSeries, view: TimeView): Band[] {
  const bands: Band[] = [];
  const end = Math.min(states.length, states.indexAfter(view.to_us) + 1);
  for (let i = Math.max(0, states.indexAfter(view.from_us) - 1); i < end; i++) {
    const t_us = states.time(i);
    const mode = MODES[states.value('mode', i)] ?? 'lost';
    const gps_denied = states.value('gps_denied', i) === 1;
    const last = bands[bands.length - 1];
    const joined = last && t_us - last.to_us <= HOLD_US;
    if (joined) last.to_us = t_us;
    if (!joined || last.mode !== mode || last.gps_denied !== gps_denied) bands.push({ from_us: t_us, to_us: t_us, mode, gps_denied });
  }
  return bands;
}

export interface FixCounts {
  accepted: number[];
  rejected: number[];
}

export function fixCounts({ fixes }: VehicleSeries, view: TimeView, bins: number): FixCounts {
  const counts = { accepted: new Array<number>(bins).fill(0), rejected: new Array<number>(bins).fill(0) };
  for (let i = fixes.indexAfter(view.from_us - 1); i < fixes.length && fixes.time(i) <= view.to_us; i++) {
    const bin = Math.min(bins - 1, Math.floor(partOf(view, fixes.time(i)) * bins));
    (fixes.value('accepted', i) === 1 ? counts.accepted : counts.rejected)[bin]! += 1;
  }
  return counts;
}

export const total = (counts: readonly number[]) => counts.reduce((sum, count) => sum + count, 0);

/** Marks of a window in the order of time: alarms, landings and words, targets, and changes of mode and of GPS. */
export function marksIn(vehicle_id: string, series: VehicleSeries, events: readonly TimeMark[], targets: readonly Target[], view: TimeView): TimeMark[] {
  const inside = (t_us: number) => t_us >= view.from_us && t_us <= view.to_us;
  const marks = events.filter((mark) => inside(mark.t_us));
  for (const { id, properties } of targets) {
    const t_us = properties.t_unix_us ?? properties.created_unix_us;
    if (properties.vehicle_id !== vehicle_id || !inside(t_us)) continue;
    marks.push({ id: `target/${id}`, t_us, kind: 'target', vehicle_id, severity: 'info', text: `target: ${properties.name}` });
  }
  const bands = bandsIn(series, view);
  bands.forEach((band, i) => {
    const before = bands[i - 1];
    if (!before || !inside(band.from_us)) return;
    const mark = { t_us: band.from_us, vehicle_id, severity: 'info' as const };
    if (before.mode !== band.mode) marks.push({ ...mark, id: `mode/${band.from_us}`, kind: 'mode', text: `mode: ${MODE_WORDS[band.mode]}` });
    if (before.gps_denied !== band.gps_denied) {
      marks.push({ ...mark, id: `denied/${band.from_us}`, kind: 'gps_denied', text: band.gps_denied ? 'GPS kept from the estimator' : 'GPS given back' });
    }
  });
  return marks.sort((a, b) => a.t_us - b.t_us);
}

/** What is at a time, for the pointer: marks and an attempt at a fix within `within_us`, and the mode. */
export function wordsAt(series: VehicleSeries, marks: readonly TimeMark[], t_us: number, within_us: number): string[] {
  const near = marks.filter((mark) => Math.abs(mark.t_us - t_us) <= within_us);
  near.sort((a, b) => Math.abs(a.t_us - t_us) - Math.abs(b.t_us - t_us));
  const words = near.slice(0, 4).map((mark) => (mark.kind === 'alarm_cleared' ? `cleared: ${mark.text}` : mark.text));
  if (near.length > 4) words.push(`and ${near.length - 4} more`);
  const fix = series.fixes.nearest(t_us, within_us);
  if (fix >= 0) {
    const nis = series.fixes.value('nis', fix);
    const off = Number.isNaN(nis) ? '' : `, ${formatNumber(Math.sqrt(nis), 1)} σ off`;
    words.push(series.fixes.value('accepted', fix) === 1 ? `fix accepted${off}` : `fix refused: ${series.reasonOf(fix) || 'no reason told'}${off}`);
  }
  const state = series.states.nearest(t_us, HOLD_US);
  if (state >= 0) words.push(`mode: ${MODE_WORDS[MODES[series.states.value('mode', state)] ?? 'lost']}`);
  return words;
}

const TICKS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600];

/** Round times, at most `most` of them. */
export function ticksIn(view: TimeView, most: number): number[] {
  const width_s = (view.to_us - view.from_us) / 1e6;
  const step_us = 1e6 * (TICKS_S.find((step_s) => width_s / step_s <= most) ?? 3600);
  const ticks: number[] = [];
  for (let t_us = Math.ceil(view.from_us / step_us) * step_us; t_us <= view.to_us; t_us += step_us) ticks.push(t_us);
  return ticks;
}
