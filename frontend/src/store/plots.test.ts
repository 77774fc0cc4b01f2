import { describe, expect, it } from 'vitest';
import type { StateMessage } from '../api/types';
import { csvOf, PLOTS, plotData, valuesAt } from './plots';
import { VehicleSeries } from './series';

const T0_US = 1_760_000_000_000_000;

function flown(): VehicleSeries {
  const series = new VehicleSeries();
  for (let i = 0; i < 100; i++) {
    const t_us = T0_US + i * 100_000;
    series.state({
      type: 'state', vehicle_id: '1', t_unix_us: t_us + 30_000, t_state_unix_us: t_us, epoch: 1, mode: i < 50 ? 'gps' : 'vision', gps_denied: i >= 50,
      lat_deg: 47.1234567, lon_deg: 8, alt_amsl_m: 500 + i, alt_agl_m: 100, std_n_m: 2, std_e_m: 3, std_d_m: 1, cov_ne_m2: 0, ground_speed_m_s: 5,
    } as unknown as StateMessage);
  }
  series.gps({ type: 'gps', t_unix_us: T0_US, t_gps_unix_us: T0_US + 500_000, fix_type: 3, lat_deg: 47.1234567, lon_deg: 8, std_horizontal_m: null } as never);
  series.fix({ type: 'fix', t_unix_us: T0_US + 9e6, t_fix_unix_us: T0_US + 550_000, accepted: false, reason: 'too dark, "night"', lat_deg: null, lon_deg: null, cov_ne_m2: null, elapsed_ms: 7 } as never);
  return series;
}

const view = { from_us: T0_US, to_us: T0_US + 20e6 };
const plot = (id: string) => PLOTS.find((one) => one.id === id)!;

describe('plotData', () => {
  it('has the curves and three sigmas to both sides', () => {
    const [t_s, north, upper, lower] = plotData(plot('error-north'), flown(), view, 400);
    expect(t_s).toEqual([T0_US / 1e6 + 0.5]);
    expect(north![0]).toBeCloseTo(0, 3);
    expect([upper![0], lower![0]]).toEqual([6, -6]);
  });

  it('has equal lengths for every plot', () => {
    for (const one of PLOTS) {
      const data = plotData(one, flown(), view, 10);
      expect(data.length, one.id).toBe(1 + one.curves.length + (one.band === undefined ? 0 : 2));
      expect(new Set(data.map((column) => column.length)).size, one.id).toBe(1);
    }
  });

  it('takes only columns that there are', () => {
    const series = new VehicleSeries();
    for (const { source, curves, band } of PLOTS) {
      for (const { column } of curves) expect(series[source].names).toContain(column);
      if (typeof band === 'string') expect(series[source].names).toContain(band);
    }
  });
});

describe('valuesAt', () => {
  it('finds each stage though their rows are apart', () => {
    const series = flown();
    series.delay(T0_US + 10e6, { video_ms: 4 });
    expect(valuesAt(plot('latencies'), series, T0_US + 10e6)).toEqual([4, 7, 30, null]);
    expect(valuesAt(plot('height'), series, T0_US + 1_010_000)).toEqual([510, 100]);
    expect(valuesAt(plot('height'), series, T0_US + 60e6)).toEqual([null, null]);
  });
});

describe('csvOf', () => {
  it('has a line for every time, with the numbers as they are kept', () => {
    const lines = csvOf(flown(), { from_us: T0_US + 400_000, to_us: T0_US + 600_000 }).trim().split('\r\n');
    const names = lines[0]!.split(',');
    const rows = lines.slice(1).map((line) => line.split(','));
    const cell = (row: string[], name: string) => row[names.indexOf(name)];
    // Three states, a reading at the second of them, a refused fix, and the ages of the states, told 30 ms later.
    expect(rows.map((row) => Number(row[0]) - T0_US)).toEqual([400_000, 430_000, 500_000, 530_000, 550_000, 600_000]);
    expect(cell(rows[2]!, 'lat_deg')).toBe('47.12345670');
    expect(cell(rows[2]!, 'alt_amsl_m')).toBe('505.000');
    expect(Number(cell(rows[2]!, 'error_north_m'))).toBeCloseTo(0, 3);
    expect(cell(rows[2]!, 'mode')).toBe('gps');
    expect(cell(rows[0]!, 'error_north_m')).toBe('');
    expect(lines[5]).toContain('"too dark, ""night"""');
  });
});
