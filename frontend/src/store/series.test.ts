import { describe, expect, it } from 'vitest';
import type { History, StateMessage, StationMessage } from '../api/types';
import { offsetBy } from '../geo/earth';
import { HOUR_US, SeriesBook, VehicleSeries, ellipse95 } from './series';

const HOME = { lat_deg: 58.4, lon_deg: 15.6 };
const T0_US = 1_760_000_000_000_000;

function state(t_us: number, north_m = 0, more: object = {}): StateMessage {
  return {
    type: 'state', vehicle_id: '1', seq: 1, t_unix_us: t_us + 20_000, t_state_unix_us: t_us, epoch: 1, mode: 'vision', gps_denied: false,
    ...offsetBy(HOME, north_m, 0), alt_amsl_m: 100, alt_agl_m: 60, std_n_m: 3, std_e_m: 4, std_d_m: 1, cov_ne_m2: 0, vn_m_s: 10,
    ve_m_s: 0, vd_m_s: 0, ground_speed_m_s: 10, roll_deg: 1, pitch_deg: 2, heading_deg: 3, last_fix_age_s: 0.5, ...more,
  } as unknown as StateMessage;
}

const gps = (t_us: number, north_m: number, east_m = 0, std_horizontal_m: number | null = null) =>
  ({ type: 'gps', vehicle_id: '1', t_unix_us: t_us + 5, t_gps_unix_us: t_us, fix_type: 3, ...offsetBy(HOME, north_m, east_m), std_horizontal_m }) as StationMessage;

const fix = (t_us: number, north_m: number | null, accepted: boolean, reason = '') =>
  ({
    type: 'fix', vehicle_id: '1', t_unix_us: t_us + 9, t_fix_unix_us: t_us, accepted, reason, elapsed_ms: 12,
    ...(north_m === null ? { lat_deg: null, lon_deg: null, cov_ne_m2: null } : { ...offsetBy(HOME, north_m, 0), cov_ne_m2: [[16, 0], [0, 9]] }),
  }) as unknown as StationMessage;

function flown(seconds: number, rate_hz = 10): SeriesBook {
  const book = new SeriesBook();
  for (let i = 0; i <= seconds * rate_hz; i++) book.apply(state(T0_US + (i * 1e6) / rate_hz, (10 * i) / rate_hz));
  return book;
}

describe('VehicleSeries', () => {
  it('compares GPS with the estimate of its own time, not of its arrival', () => {
    const book = flown(1);
    // Between two states, half a second before the newest: the vehicle flies ten metres in a second.
    book.apply(gps(T0_US + 450_000, 4.5 + 2, -1));
    const { errors } = book.of('1');
    expect(errors.length).toBe(1);
    expect(errors.value('north_m', 0)).toBeCloseTo(2, 2);
    expect(errors.value('east_m', 0)).toBeCloseTo(-1, 2);
    expect(errors.value('horizontal_m', 0)).toBeCloseTo(Math.hypot(2, 1), 2);
    expect(errors.value('std_n_m', 0)).toBeCloseTo(3, 5);
  });

  it('waits for a state after a reading, and adds what the receiver says of itself', () => {
    const book = flown(1);
    book.apply(gps(T0_US + 1_050_000, 10.5, 0, 2));
    expect(book.of('1').errors.length).toBe(0);
    book.apply(state(T0_US + 1_100_000, 11));
    expect(book.of('1').errors.length).toBe(1);
    expect(book.of('1').errors.value('std_e_m', 0)).toBeCloseTo(Math.sqrt(16 + 2), 4);
  });

  it('tells innovations in sigmas of estimate and fix together', () => {
    const book = flown(1);
    book.apply(fix(T0_US + 300_000, 3 + 10, true));
    book.apply(fix(T0_US + 400_000, null, false, 'ambiguous (0.31)'));
    const { fixes } = book.of('1');
    expect(fixes.value('north_sigmas', 0)).toBeCloseTo(10 / 5, 2);
    expect(fixes.value('nis', 0)).toBeCloseTo(4, 1);
    expect(fixes.value('nis', 1)).toBeNaN();
    expect(fixes.value('accepted', 1)).toBe(0);
    expect(book.of('1').reasonOf(1)).toBe('ambiguous');
  });

  it('stays within its memory over hours at fifty a second', { timeout: 60_000 }, () => {
    const series = new VehicleSeries();
    const { bytes } = series;
    for (let i = 0; i < 50 * 900; i++) series.state(state(T0_US + i * 20_000));
    expect(series.states.length).toBe(9000);
    for (let i = 0; i < 38_000; i++) series.state(state(T0_US + 900e6 + i * 100_000));
    expect(series.bytes).toBe(bytes);
    expect(bytes).toBeLessThan(8e6);
    expect(series.last_us! - series.first_us!).toBeGreaterThanOrEqual(HOUR_US - 1e6);
  });

  it('gives back the state of a time with its ellipse', () => {
    const book = flown(2);
    const found = book.of('1').stateAt('1', T0_US + 1_030_000)!;
    expect(found.t_state_unix_us).toBe(T0_US + 1_000_000);
    expect(found.lat_deg).toBeCloseTo(offsetBy(HOME, 10, 0).lat_deg, 9);
    expect(found.roll_deg).toBe(1);
    expect(found.mode).toBe('vision');
    expect(found.ellipse95!.semi_major_m).toBeCloseTo(4 * 2.4477, 3);
    expect(found.ellipse95!.azimuth_deg).toBeCloseTo(90, 6);
    expect(book.of('1').stateAt('1', T0_US + 9e6)).toBeNull();
  });

  it('forgets what was before its clock was set back', () => {
    const book = flown(2);
    book.apply(state(T0_US - HOUR_US));
    expect(book.of('1').states.length).toBe(1);
  });

  it('puts the station’s memory in front of what was heard, by the same arithmetic', () => {
    const book = new SeriesBook();
    for (let i = 6; i <= 10; i++) book.apply(state(T0_US + i * 100_000, i));
    book.apply(fix(T0_US + 900_000, null, false, 'too dark'));
    book.prime('1', remembered());
    const { states, errors, fixes } = book.of('1');
    expect(states.first_us).toBe(T0_US);
    // Half a second apart where the station remembers, and all that was heard: 0, 0.2 and 0.6 s to 1 s.
    expect(Array.from({ length: states.length }, (_, i) => (states.time(i) - T0_US) / 1e5)).toEqual([0, 6, 7, 8, 9, 10]);
    expect(errors.value('north_m', 0)).toBeCloseTo(5, 2);
    expect(Array.from({ length: fixes.length }, (_, i) => book.of('1').reasonOf(i))).toEqual(['', 'ambiguous', 'too dark']);
  });

  it('knows a replay only as a whole', () => {
    const book = new SeriesBook();
    book.apply({ ...state(T0_US), vehicle_id: 'replay-a' });
    expect(book.of('replay-a').states.length).toBe(0);
    book.prime('replay-a', remembered());
    book.prime('replay-a', remembered());
    expect(book.of('replay-a').states.length).toBe(4);
  });
});

/** Every 0.2 s to 0.6 s, with a reading five metres north and two attempts. */
function remembered(): History {
  const t_unix_us = [0, 200_000, 400_000, 600_000].map((t) => T0_US + t);
  const all = (value: number) => t_unix_us.map(() => value);
  const places = t_unix_us.map((t) => offsetBy(HOME, (t - T0_US) / 1e5, 0));
  const at = offsetBy(HOME, 3 + 5, 0);
  return {
    vehicle_id: '1',
    states: {
      t_unix_us, epoch: all(1), mode: t_unix_us.map(() => 'gps' as const), gps_denied: t_unix_us.map(() => false),
      lat_deg: places.map((p) => p.lat_deg), lon_deg: places.map((p) => p.lon_deg), alt_amsl_m: all(1), alt_agl_m: all(1), std_n_m: all(1),
      std_e_m: all(1), std_d_m: all(1), cov_ne_m2: all(0), vn_m_s: all(3), ve_m_s: all(4), vd_m_s: all(0), roll_deg: all(0),
      pitch_deg: all(0), heading_deg: all(0), last_fix_age_s: all(0), age_ms: all(20), video_offset_ms: t_unix_us.map(() => null),
    },
    gps: { t_unix_us: [T0_US + 300_000], lat_deg: [at.lat_deg], lon_deg: [at.lon_deg], alt_amsl_m: [1], std_horizontal_m: [null], used: [true] },
    fixes: {
      t_unix_us: [T0_US + 100_000, T0_US + 500_000], kind: ['match', 'match'], accepted: [true, false], reason: ['', 'ambiguous (1)'],
      lat_deg: [HOME.lat_deg, null], lon_deg: [HOME.lon_deg, null], var_n_m2: [1, null], var_e_m2: [1, null], cov_ne_m2: [0, null],
      score: [1, 0], elapsed_ms: [9, 9],
    },
    video: { t_unix_us: [T0_US + 50_000], latency_ms: [7] },
    events: [],
  };
}

describe('ellipse95', () => {
  it('turns with the covariance', () => {
    const found = ellipse95(2, 2, 3.9)!;
    expect(found.azimuth_deg).toBeCloseTo(45, 6);
    expect(found.semi_major_m).toBeGreaterThan(found.semi_minor_m * 5);
  });
});
