/**
 * What a vehicle's navigation was like over the last hour: every quantity by the clock it belongs to. Pure.
 *
 * States by the time they are for, GPS by the receiver's, fixes by their picture's exposure. The station's memory goes
 * through the same arithmetic as what is heard, so that a page that comes late shows the same curves.
 */

import type { FixMessage, GpsMessage, History, Mode, StateMessage, StationMessage } from '../api/types';
import { offsetBetween, offsetBy } from '../geo/earth';
import { Columns, type Row } from './columns';
import { stateTime_us } from './history';

export const MODES: readonly Mode[] = ['gps', 'vision', 'dead_reckoning', 'lost'];
export const HOUR_US = 3_600_000_000;
const ROWS = 36_000; // an hour at ten a second
const STEP_US = 95_000;
const GAP_US = 1_500_000;
/** The station tells a state every half second. */
const APART_US = 400_000;
const READINGS_WAIT = 50;
const REASONS_KEPT = 500;
const CLOCK_SET_US = 5_000_000;
/** Semi-axes of the ellipse that holds 95 % of a normal distribution in the plane, in sigmas. */
const ELLIPSE95_SIGMAS = Math.sqrt(-2 * Math.log(0.05));

const STATE_NUMBERS = [
  'lat_deg', 'lon_deg', 'alt_amsl_m', 'alt_agl_m', 'std_n_m', 'std_e_m', 'std_d_m', 'cov_ne_m2', 'vn_m_s', 've_m_s',
  'vd_m_s', 'roll_deg', 'pitch_deg', 'heading_deg', 'last_fix_age_s',
] as const;

interface Reading {
  t_us: number;
  lat_deg: number;
  lon_deg: number;
  std_horizontal_m: number | null;
}

interface Fix {
  t_us: number;
  accepted: boolean;
  reason: string;
  lat_deg: number | null;
  lon_deg: number | null;
  var_n_m2: number | null;
  var_e_m2: number | null;
  cov_ne_m2: number | null;
}

export class VehicleSeries {
  readonly states = new Columns(
    [...STATE_NUMBERS, 'epoch', 'mode', 'gps_denied', 'speed_m_s', 'video_offset_ms'],
    { capacity: ROWS, step_us: STEP_US, fine: ['lat_deg', 'lon_deg'] },
  );
  /** GPS minus the estimate that was shown for its time, and one sigma of that difference. */
  readonly errors = new Columns(['north_m', 'east_m', 'horizontal_m', 'std_n_m', 'std_e_m'], { capacity: ROWS, step_us: STEP_US });
  /** Fix minus the estimate that was shown for its time, in sigmas of that difference; NaN where no place was found. */
  readonly fixes = new Columns(['accepted', 'reason', 'north_sigmas', 'east_sigmas', 'nis'], { capacity: ROWS });
  /** Milliseconds, each column at its own pace. */
  readonly delays = new Columns(['state_ms', 'video_ms', 'registration_ms', 'drawn_ms'], { capacity: ROWS });
  private readonly reasons: string[] = [];
  private waiting: Reading[] = [];

  get first_us(): number | null {
    return this.states.first_us;
  }

  get last_us(): number | null {
    return this.states.last_us;
  }

  get bytes(): number {
    return this.states.bytes + this.errors.bytes + this.fixes.bytes + this.delays.bytes;
  }

  state(message: StateMessage): void {
    const t_us = stateTime_us(message);
    const { last_us } = this.states;
    // A clock that was set back: what was before belongs to another one.
    if (last_us !== null && t_us < last_us - CLOCK_SET_US) this.clear();
    const kept = this.states.push(t_us, {
      ...pick(message),
      epoch: message.epoch,
      mode: MODES.indexOf(message.mode),
      gps_denied: Number(message.gps_denied),
      speed_m_s: message.ground_speed_m_s,
      video_offset_ms: offset_ms(message.video_clock?.time_offset_s),
    });
    if (!kept) return;
    // By the time they were told: pictures are older than states, and rows ascend.
    if (message.t_state_unix_us !== undefined) this.delay(message.t_unix_us, { state_ms: (message.t_unix_us - t_us) / 1000 });
    this.settle();
  }

  gps(message: GpsMessage): void {
    const { lat_deg, lon_deg, std_horizontal_m } = message;
    if (message.fix_type < 2 || lat_deg === null || lon_deg === null) return;
    this.waiting.push({ t_us: message.t_gps_unix_us ?? message.t_unix_us, lat_deg, lon_deg, std_horizontal_m });
    if (this.waiting.length > READINGS_WAIT) this.waiting.shift();
    this.settle();
  }

  fix(message: FixMessage): void {
    const cov = message.cov_ne_m2 as (number | null)[][] | null;
    this.addFix({
      t_us: message.t_fix_unix_us ?? message.t_unix_us,
      accepted: message.accepted,
      reason: message.reason ?? '',
      lat_deg: message.lat_deg,
      lon_deg: message.lon_deg,
      var_n_m2: cov?.[0]?.[0] ?? null,
      var_e_m2: cov?.[1]?.[1] ?? null,
      cov_ne_m2: cov?.[0]?.[1] ?? null,
    });
    if (message.elapsed_ms !== null) this.delay(message.t_unix_us, { registration_ms: message.elapsed_ms });
  }

  /** By the time it was told. `video_ms`: at the station; `drawn_ms`: from its door to this page's screen. */
  delay(t_us: number, delays: Row): void {
    // Two may be told in one microsecond, and none must be lost for that.
    this.delays.push(Math.max(t_us, (this.delays.last_us ?? 0) + 1), delays);
  }

  reasonOf(index: number): string {
    return this.reasons[this.fixes.value('reason', index)] ?? '';
  }

  /** What the station remembers goes where nothing was heard: before, and while the page was cut off. */
  prime(history: History): void {
    const older = VehicleSeries.of(history);
    this.states.fill(older.states, APART_US);
    this.errors.fill(older.errors, APART_US);
    this.delays.fill(older.delays, APART_US);
    const moved = older.fixes;
    const words = new Map<number, string>();
    for (let i = 0; i < moved.length; i++) words.set(moved.time(i), older.reasonOf(i));
    for (let i = 0; i < this.fixes.length; i++) words.set(this.fixes.time(i), this.reasonOf(i));
    this.fixes.fill(moved, 0);
    // The words have other numbers here.
    this.fixes.map('reason', (t_us) => this.reason(words.get(t_us) ?? ''));
  }

  static of(history: History): VehicleSeries {
    const series = new VehicleSeries();
    const { states, gps, fixes, video } = history;
    states.t_unix_us.forEach((t_us, i) => {
      const row = Object.fromEntries(STATE_NUMBERS.map((name) => [name, states[name][i]]));
      const speed_m_s = Math.hypot(states.vn_m_s[i] ?? NaN, states.ve_m_s[i] ?? NaN);
      const mode = MODES.indexOf(states.mode[i]!);
      const gps_denied = Number(states.gps_denied[i]);
      const video_offset_ms = states.video_offset_ms[i] ?? null;
      series.states.push(t_us, { ...row, speed_m_s, mode, gps_denied, video_offset_ms, epoch: states.epoch[i] ?? 0 });
    });
    gps.t_unix_us.forEach((t_us, i) => {
      const [lat_deg, lon_deg] = [gps.lat_deg[i] ?? NaN, gps.lon_deg[i] ?? NaN];
      series.compare({ t_us, lat_deg, lon_deg, std_horizontal_m: gps.std_horizontal_m[i] ?? null });
    });
    fixes.t_unix_us.forEach((t_us, i) => {
      const number = (column: (number | null)[]) => column[i] ?? null;
      series.addFix({
        t_us,
        accepted: fixes.accepted[i]!,
        reason: fixes.reason[i]!,
        lat_deg: number(fixes.lat_deg),
        lon_deg: number(fixes.lon_deg),
        var_n_m2: number(fixes.var_n_m2),
        var_e_m2: number(fixes.var_e_m2),
        cov_ne_m2: number(fixes.cov_ne_m2),
      });
    });
    const delays: { t_us: number; row: Record<string, number | null> }[] = [
      ...states.t_unix_us.map((t_us, i) => ({ t_us, row: { state_ms: states.age_ms[i] ?? null } })),
      ...video.t_unix_us.map((t_us, i) => ({ t_us, row: { video_ms: video.latency_ms[i] ?? null } })),
      ...fixes.t_unix_us.map((t_us, i) => ({ t_us, row: { registration_ms: fixes.elapsed_ms[i] ?? null } })),
    ];
    delays.sort((a, b) => a.t_us - b.t_us);
    for (const { t_us, row } of delays) series.delay(t_us, row);
    return series;
  }

  /** The state of a time as the stream would tell it, without what is not kept; null where none is near. */
  stateAt(vehicle_id: string, t_us: number, within_us = 1_000_000): StateMessage | null {
    const at = this.states.nearest(t_us, within_us);
    if (at < 0) return null;
    const number = (name: string): number | null => {
      const value = this.states.value(name, at);
      return Number.isNaN(value) ? null : value;
    };
    const numbers = Object.fromEntries(STATE_NUMBERS.map((name) => [name, number(name)])) as Record<(typeof STATE_NUMBERS)[number], number | null>;
    const time_us = this.states.time(at);
    return {
      type: 'state',
      seq: 0,
      t_unix_us: time_us,
      t_state_unix_us: time_us,
      vehicle_id,
      epoch: number('epoch') ?? 0,
      mode: MODES[number('mode') ?? 3] ?? 'lost',
      gps_denied: number('gps_denied') === 1,
      process_model: null,
      ...numbers,
      ground_speed_m_s: number('speed_m_s'),
      ellipse95: ellipse95(numbers.std_n_m, numbers.std_e_m, numbers.cov_ne_m2),
      footprint: null,
    };
  }

  /** Where GPS was at a time, out of the estimate and its difference to it; null where there was none. */
  gpsAt(vehicle_id: string, t_us: number): GpsMessage | null {
    const number = (columns: Columns, name: string) => columns.between(name, t_us, GAP_US);
    const [north_m, east_m] = [number(this.errors, 'north_m'), number(this.errors, 'east_m')];
    const [lat_deg, lon_deg] = [number(this.states, 'lat_deg'), number(this.states, 'lon_deg')];
    if (Number.isNaN(north_m + east_m + lat_deg + lon_deg)) return null;
    return {
      type: 'gps', seq: 0, t_unix_us: t_us, t_gps_unix_us: t_us, vehicle_id, ...offsetBy({ lat_deg, lon_deg }, north_m, east_m),
      alt_amsl_m: null, fix_type: 3, satellites: null, std_horizontal_m: null, used: number(this.states, 'gps_denied') < 0.5,
    };
  }

  clear(): void {
    for (const columns of [this.states, this.errors, this.fixes, this.delays]) columns.clear();
    this.waiting = [];
  }

  private addFix(fix: Fix): void {
    this.fixes.push(fix.t_us, { accepted: Number(fix.accepted), reason: this.reason(fix.reason), ...this.innovation(fix) });
  }

  private innovation(fix: Fix): Row {
    if (fix.lat_deg === null || fix.lon_deg === null) return {};
    const at = (name: string) => this.states.between(name, fix.t_us, GAP_US);
    const estimate = { lat_deg: at('lat_deg'), lon_deg: at('lon_deg') };
    const { north_m, east_m } = offsetBetween(estimate, { lat_deg: fix.lat_deg, lon_deg: fix.lon_deg });
    const nn = at('std_n_m') ** 2 + (fix.var_n_m2 ?? NaN);
    const ee = at('std_e_m') ** 2 + (fix.var_e_m2 ?? NaN);
    const ne = at('cov_ne_m2') + (fix.cov_ne_m2 ?? 0);
    const nis = (ee * north_m ** 2 - 2 * ne * north_m * east_m + nn * east_m ** 2) / (nn * ee - ne * ne);
    return { north_sigmas: north_m / Math.sqrt(nn), east_sigmas: east_m / Math.sqrt(ee), nis };
  }

  /** Readings are compared once there is a state after them. */
  private settle(): void {
    const last_us = this.states.last_us ?? -Infinity;
    while (this.waiting[0] && this.waiting[0].t_us <= last_us) this.compare(this.waiting.shift()!);
  }

  private compare(reading: Reading): void {
    const at = (name: string) => this.states.between(name, reading.t_us, GAP_US);
    const { north_m, east_m } = offsetBetween({ lat_deg: at('lat_deg'), lon_deg: at('lon_deg') }, reading);
    if (Number.isNaN(north_m + east_m)) return;
    // The receiver's figure is of the plane; along each axis it is smaller by the root of two.
    const gps_m2 = (reading.std_horizontal_m ?? 0) ** 2 / 2;
    this.errors.push(reading.t_us, {
      north_m,
      east_m,
      horizontal_m: Math.hypot(north_m, east_m),
      std_n_m: Math.sqrt(at('std_n_m') ** 2 + gps_m2),
      std_e_m: Math.sqrt(at('std_e_m') ** 2 + gps_m2),
    });
  }

  /** The number of a reason: without the figures in brackets there are few. */
  private reason(text: string): number {
    const words = text.split(' (')[0]!;
    const known = this.reasons.indexOf(words);
    if (known >= 0) return known;
    if (this.reasons.length >= REASONS_KEPT) return REASONS_KEPT;
    return this.reasons.push(words) - 1;
  }
}

function pick(message: StateMessage): Record<(typeof STATE_NUMBERS)[number], number | null> {
  return Object.fromEntries(STATE_NUMBERS.map((name) => [name, message[name]])) as Record<(typeof STATE_NUMBERS)[number], number | null>;
}

function offset_ms(offset_s: number | null | undefined): number | null {
  return offset_s == null ? null : 1000 * offset_s;
}

export function ellipse95(std_n_m: number | null, std_e_m: number | null, cov_ne_m2: number | null): StateMessage['ellipse95'] {
  if (std_n_m === null || std_e_m === null) return null;
  const [nn, ee, ne] = [std_n_m ** 2, std_e_m ** 2, cov_ne_m2 ?? 0];
  const middle = (nn + ee) / 2;
  const spread = Math.hypot((nn - ee) / 2, ne);
  const azimuth_deg = ((Math.atan2(ne, (nn - ee) / 2) / 2) * 180) / Math.PI;
  return {
    semi_major_m: ELLIPSE95_SIGMAS * Math.sqrt(middle + spread),
    semi_minor_m: ELLIPSE95_SIGMAS * Math.sqrt(Math.max(0, middle - spread)),
    azimuth_deg: (azimuth_deg + 180) % 180,
  };
}

/** The series of all vehicles. What replays say is left out: their flights are known as a whole. */
export class SeriesBook {
  private readonly vehicles = new Map<string, VehicleSeries>();

  of(vehicle_id: string): VehicleSeries {
    let series = this.vehicles.get(vehicle_id);
    if (!series) {
      series = new VehicleSeries();
      this.vehicles.set(vehicle_id, series);
    }
    return series;
  }

  apply(message: StationMessage): void {
    if (!('vehicle_id' in message) || message.vehicle_id === null || message.vehicle_id.startsWith('replay-')) return;
    const { vehicle_id } = message;
    if (message.type === 'state') this.of(vehicle_id).state(message);
    else if (message.type === 'gps') this.of(vehicle_id).gps(message);
    else if (message.type === 'fix') this.of(vehicle_id).fix(message);
    else if (message.type === 'video') this.of(vehicle_id).delay(message.t_unix_us, { video_ms: message.latency_ms });
  }

  prime(vehicle_id: string, history: History): void {
    if (vehicle_id.startsWith('replay-')) this.vehicles.set(vehicle_id, VehicleSeries.of(history));
    else this.of(vehicle_id).prime(history);
  }
}
