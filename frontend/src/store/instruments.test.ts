import { describe, expect, it } from 'vitest';
import type { GpsMessage, LinkMessage, StateMessage, TelemetryMessage } from '../api/types';
import { AVIATION, METRIC } from '../geo/units';
import { readings, type Heard, type PictureTimes } from './instruments';
import { newVehicle, type Vehicle } from './mission';

const FRESH: Heard = { state: 0.1, gps: 0.1, telemetry: 0.1, link: 0.1, video: 0.1 };
const NO_TIMES: PictureTimes = { received_ms: null, decoded_ms: null, drawn_ms: null };

const vehicle: Vehicle = {
  ...newVehicle('1'),
  state: {
    mode: 'vision', process_model: 'inertial', heading_deg: 274.4, ground_speed_m_s: 10, alt_amsl_m: 304.8, alt_agl_m: 152.4, vd_m_s: 2.54,
    std_n_m: 0.8, std_e_m: 1.1, std_d_m: 1.5, ellipse95: { semi_major_m: 2.8, semi_minor_m: 1.9, azimuth_deg: 0 }, last_fix_age_s: 0.4,
  } as StateMessage,
  telemetry: {
    battery_pct: 18, battery_v: 22.4, battery_a: 14.6, battery_age_s: 0.5, airspeed_m_s: 11, airspeed_age_s: 0.2, alt_rel_m: 118,
    alt_rel_age_s: 0.1, wind_speed_m_s: 4, wind_from_deg: 269.6, wind_age_s: 1,
  } as TelemetryMessage,
  gps: { fix_type: 3, satellites: 14, std_horizontal_m: 1, used: false } as GpsMessage,
  link: { connected: true, messages_per_s: 141, loss_pct: 0.26, signed: false, heartbeat_age_s: 0.4 } as LinkMessage,
};

function read(of: Vehicle | null, heard = FRESH, units = METRIC) {
  return Object.fromEntries(readings(of, heard, NO_TIMES, units).map((reading) => [reading.id, reading]));
}

function shown(of: Vehicle | null, heard = FRESH, units = METRIC): Record<string, string> {
  return Object.fromEntries(Object.entries(read(of, heard, units)).map(([id, r]) => [id, `${r.value} ${r.unit}`.trim()]));
}

describe('instruments', () => {
  it('read in metres', () => {
    expect(shown(vehicle)).toMatchObject({
      heading: '274 °', airspeed: '11.0 m/s', 'ground-speed': '10.0 m/s', agl: '152 m', 'above-home': '118 m', amsl: '305 m', climb: '−2.5',
      wind: '4.0 m/s', battery: '18 %', link: '141 msg/s', gps: '14 sat', fix: '0.4 s', sigma: '0.8 1.1 1.5',
    });
  });

  it('read in feet and knots', () => {
    expect(shown(vehicle, FRESH, AVIATION)).toMatchObject({
      airspeed: '21 kn', 'ground-speed': '19 kn', agl: '500 ft', 'above-home': '387 ft', amsl: '1000 ft', climb: '−500', wind: '8 kn', sigma: '2.6 3.6 4.9',
    });
  });

  it('show a dash for everything that is not known, and call none of it old', () => {
    const silent = { state: null, gps: null, telemetry: null, link: null, video: null };
    for (const nothing of [null, newVehicle('1')]) {
      const all = read(nothing, silent);
      expect(Object.values(all).filter((one) => one.id !== 'video').map((one) => one.value)).toEqual(Array(13).fill('–'));
      expect(all['video']!.value).toBe('Waiting');
      expect(Object.values(all).some((one) => one.stale)).toBe(false);
    }
  });

  it('call old what has not come for a while, and say how old', () => {
    const all = read(vehicle, { ...FRESH, state: 12 });
    expect(Object.values(all).filter((one) => one.stale).map((one) => one.id)).toEqual(['heading', 'ground-speed', 'agl', 'amsl', 'climb', 'fix', 'sigma']);
    expect(all['agl']).toMatchObject({ value: '152', below: '12 s old' });
  });

  it('call a value old whose own message stopped while others still come', () => {
    const all = read({ ...vehicle, telemetry: { ...vehicle.telemetry!, airspeed_age_s: 30 } });
    expect([all['airspeed']!.stale, all['above-home']!.stale, all['battery']!.stale]).toEqual([true, false, false]);
  });

  it('leave the decimals out beside hundreds', () => {
    const lost = { ...vehicle, state: { ...vehicle.state!, std_n_m: 103.91, ellipse95: { semi_major_m: 258.8, semi_minor_m: 209.4, azimuth_deg: 0 } } };
    expect(read(lost)['sigma']).toMatchObject({ value: '104 1 2', below: '95 % 259 × 209 m' });
  });

  it('do not age with a replay that stands', () => {
    const replay = { paused: true } as Vehicle['replay'];
    const old = { state: 60, gps: 60, telemetry: 60, link: 60, video: 60 };
    expect(Object.values(read({ ...vehicle, replay }, old)).some((one) => one.stale)).toBe(false);
  });

  it('warn of a low battery, and fall back to its voltage', () => {
    expect(read(vehicle)['battery']).toMatchObject({ tone: 'bad', below: '22.4 V 15 A' });
    const volts = { ...vehicle, telemetry: { ...vehicle.telemetry!, battery_pct: null } };
    expect(read(volts)['battery']).toMatchObject({ value: '22.4', unit: 'V', tone: 'none' });
  });

  it('say that a link is lost, how much is lost, and whether it is signed', () => {
    expect(read(vehicle)['link']).toMatchObject({ label: 'Link not signed', below: '0.3 % lost' });
    const lost = { ...vehicle, link: { ...vehicle.link!, connected: false, heartbeat_age_s: 7 } };
    expect(read(lost)['link']).toMatchObject({ value: 'LOST', below: '7.0 s ago', tone: 'bad' });
  });

  it('say where the wind comes from and what the receiver has', () => {
    expect([read(vehicle)['wind']!.below, read(vehicle)['gps']!.below, read(vehicle)['gps']!.label]).toEqual(['from 270°', '3D ±1.0 m', 'GPS not used']);
    expect(read({ ...vehicle, gps: { ...vehicle.gps!, fix_type: 1 } })['gps']).toMatchObject({ value: 'none', below: 'no fix', tone: 'bad' });
  });
});
