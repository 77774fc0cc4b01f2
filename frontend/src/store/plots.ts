/** Which plots there are, what they draw of a window, and the table of the same numbers. Pure. */

import { Columns } from './columns';
import { MODES, type VehicleSeries } from './series';
import type { TimeView } from './timeline';

type Source = 'errors' | 'states' | 'fixes' | 'delays';

export interface Curve {
  label: string;
  column: string;
  /** A variable of console.css. */
  colour: string;
  points?: boolean;
}

export interface Plot {
  id: string;
  title: string;
  unit: string;
  source: Source;
  curves: Curve[];
  /** Three times this column to both sides of zero, or a number of its own. */
  band?: string | number;
  fromZero?: boolean;
}

export const PLOTS: readonly Plot[] = [
  {
    id: 'error-north', title: 'GPS minus estimate, north', unit: 'm', source: 'errors', band: 'std_n_m',
    curves: [{ label: 'north', column: 'north_m', colour: '--accent' }],
  },
  {
    id: 'error-east', title: 'GPS minus estimate, east', unit: 'm', source: 'errors', band: 'std_e_m',
    curves: [{ label: 'east', column: 'east_m', colour: '--accent' }],
  },
  {
    id: 'error-horizontal', title: 'GPS minus estimate, horizontal', unit: 'm', source: 'errors', fromZero: true,
    curves: [{ label: 'distance', column: 'horizontal_m', colour: '--accent' }],
  },
  {
    id: 'sigmas', title: 'One sigma of the estimate', unit: 'm', source: 'states', fromZero: true,
    curves: [
      { label: 'north', column: 'std_n_m', colour: '--accent' },
      { label: 'east', column: 'std_e_m', colour: '--gps' },
      { label: 'down', column: 'std_d_m', colour: '--target' },
    ],
  },
  {
    id: 'innovations', title: 'Fix minus estimate', unit: 'σ', source: 'fixes', band: 1,
    curves: [
      { label: 'north', column: 'north_sigmas', colour: '--accent', points: true },
      { label: 'east', column: 'east_sigmas', colour: '--gps', points: true },
    ],
  },
  {
    id: 'latencies', title: 'Delays by stage', unit: 'ms', source: 'delays', fromZero: true,
    curves: [
      { label: 'video', column: 'video_ms', colour: '--gps' },
      { label: 'matching', column: 'registration_ms', colour: '--target' },
      { label: 'state', column: 'state_ms', colour: '--good' },
      { label: 'screen', column: 'drawn_ms', colour: '--accent' },
    ],
  },
  {
    id: 'height', title: 'Height', unit: 'm', source: 'states',
    curves: [
      { label: 'AMSL', column: 'alt_amsl_m', colour: '--accent' },
      { label: 'AGL', column: 'alt_agl_m', colour: '--gps' },
    ],
  },
  {
    id: 'speed', title: 'Speed over ground', unit: 'm/s', source: 'states', fromZero: true,
    curves: [{ label: 'speed', column: 'speed_m_s', colour: '--accent' }],
  },
  {
    id: 'clock', title: 'Offset of the video’s clock', unit: 'ms', source: 'states',
    curves: [{ label: 'offset', column: 'video_offset_ms', colour: '--accent' }],
  },
];

/** Times in Unix seconds, then the curves, then the upper and the lower edge of the band where there is one. */
export type PlotData = [number[], ...(number | null)[][]];

export function plotData(plot: Plot, series: VehicleSeries, view: TimeView, buckets: number): PlotData {
  const names = plot.curves.map((curve) => curve.column);
  const band = typeof plot.band === 'string' ? [plot.band] : [];
  const { t_us, values } = series[plot.source].curves([...names, ...band], view.from_us, view.to_us, buckets);
  const data: PlotData = [t_us.map((t) => t / 1e6), ...values.slice(0, names.length)];
  if (plot.band === undefined) return data;
  const edge = typeof plot.band === 'number' ? t_us.map(() => plot.band as number) : values[names.length]!;
  data.push(edge.map((std) => (std === null ? null : 3 * std)), edge.map((std) => (std === null ? null : -3 * std)));
  return data;
}

/** What one knows at a time, for the legend: the nearest row within two seconds; null where there is none. */
export function valuesAt(plot: Plot, series: VehicleSeries, t_us: number): (number | null)[] {
  const columns = series[plot.source];
  return plot.curves.map(({ column }) => {
    // Delays have a row for each stage: the one that is asked for may be a few rows away.
    for (let by = 0, at = columns.nearest(t_us, 2e6); at >= 0 && by <= 24; by++) {
      for (const i of by === 0 ? [at] : [at - by, at + by]) {
        if (i < 0 || i >= columns.length || Math.abs(columns.time(i) - t_us) > 2e6) continue;
        const value = columns.value(column, i);
        if (!Number.isNaN(value)) return value;
      }
    }
    return null;
  });
}

interface Table {
  columns: Columns;
  /** Name in the file, column, digits. */
  fields: [string, string, number][];
}

const tables = (series: VehicleSeries): Table[] => [
  {
    columns: series.states,
    fields: [
      ['lat_deg', 'lat_deg', 8], ['lon_deg', 'lon_deg', 8], ['alt_amsl_m', 'alt_amsl_m', 3], ['alt_agl_m', 'alt_agl_m', 3],
      ['std_n_m', 'std_n_m', 4], ['std_e_m', 'std_e_m', 4], ['std_d_m', 'std_d_m', 4], ['speed_m_s', 'speed_m_s', 3],
      ['roll_deg', 'roll_deg', 3], ['pitch_deg', 'pitch_deg', 3], ['heading_deg', 'heading_deg', 3], ['video_offset_ms', 'video_offset_ms', 2],
    ],
  },
  {
    columns: series.errors,
    fields: [['error_north_m', 'north_m', 4], ['error_east_m', 'east_m', 4], ['error_horizontal_m', 'horizontal_m', 4]],
  },
  {
    columns: series.fixes,
    fields: [
      ['fix_accepted', 'accepted', 0], ['fix_north_sigmas', 'north_sigmas', 3], ['fix_east_sigmas', 'east_sigmas', 3], ['fix_nis', 'nis', 3],
    ],
  },
  {
    columns: series.delays,
    fields: [['state_ms', 'state_ms', 2], ['video_ms', 'video_ms', 2], ['registration_ms', 'registration_ms', 2], ['drawn_ms', 'drawn_ms', 2]],
  },
];

/** Every row of a window, as it is kept: a line for each time at which anything is known, empty where it is not. */
export function csvOf(series: VehicleSeries, view: TimeView): string {
  const all = tables(series);
  const lines = new Map<number, Map<string, string>>();
  const lineAt = (t_us: number) => {
    let line = lines.get(t_us);
    if (!line) lines.set(t_us, (line = new Map()));
    return line;
  };
  for (const { columns, fields } of all) {
    for (let i = columns.indexAfter(view.from_us - 1); i < columns.length && columns.time(i) <= view.to_us; i++) {
      const line = lineAt(columns.time(i));
      for (const [name, column, digits] of fields) {
        const value = columns.value(column, i);
        if (!Number.isNaN(value)) line.set(name, value.toFixed(digits));
      }
      if (columns === series.states) {
        line.set('mode', MODES[columns.value('mode', i)] ?? '');
        line.set('gps_denied', String(columns.value('gps_denied', i)));
      }
      if (columns === series.fixes) line.set('fix_reason', series.reasonOf(i));
    }
  }
  const names = ['mode', 'gps_denied', ...all.flatMap(({ fields }) => fields.map(([name]) => name)), 'fix_reason'];
  const body = [...lines.entries()]
    .sort(([a], [b]) => a - b)
    .map(([t_us, line]) => [String(t_us), ...names.map((name) => quoted(line.get(name) ?? ''))].join(','));
  return [['t_unix_us', ...names].join(','), ...body].join('\r\n') + '\r\n';
}

function quoted(text: string): string {
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
