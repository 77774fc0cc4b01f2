/** How the page is set, as it is kept and exchanged. Pure: whatever is read is checked field by field. */

import { COORDINATE_FORMATS, type CoordinateFormat } from '../geo/format';
import { LENGTH_UNITS, SPEED_UNITS, type LengthUnit, type SpeedUnit } from '../geo/units';

export const SETTINGS_VERSION = 1;

export const THEMES = { system: 'As the system', dark: 'Dark', light: 'Light', sunlight: 'Sunlight, high contrast' } as const;
export const MOTIONS = { system: 'As the system', reduced: 'Reduced' } as const;
export const LAYOUTS = { split: 'Map and video', map: 'Map alone', video: 'Video alone', inset: 'Picture in picture' } as const;

export type Theme = keyof typeof THEMES;
export type Motion = keyof typeof MOTIONS;
export type Layout = keyof typeof LAYOUTS;
export type LayerName = 'imagery' | 'gps' | 'vision' | 'ellipse' | 'footprint' | 'targets';

export interface Settings {
  theme: Theme;
  length: LengthUnit;
  speed: SpeedUnit;
  format: CoordinateFormat;
  spokenAlarms: boolean;
  motion: Motion;
  layout: Layout;
  /** The video has the large place. */
  videoLarge: boolean;
  sidePanel: boolean;
  instruments: boolean;
  layers: Record<LayerName, boolean>;
}

export const DEFAULT_SETTINGS: Readonly<Settings> = {
  theme: 'dark',
  length: 'm',
  speed: 'm_s',
  format: 'dd',
  spokenAlarms: false,
  motion: 'system',
  layout: 'split',
  videoLarge: false,
  sidePanel: true,
  instruments: true,
  layers: { imagery: true, gps: true, vision: true, ellipse: true, footprint: true, targets: true },
};

const CHOICES: { readonly [K in keyof Settings]?: object } = {
  theme: THEMES,
  length: LENGTH_UNITS,
  speed: SPEED_UNITS,
  format: COORDINATE_FORMATS,
  motion: MOTIONS,
  layout: LAYOUTS,
};

export interface ReadSettings {
  settings: Settings;
  /** What was not as it should be, in words; empty when all was. */
  faults: string[];
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === 'object' && value !== null && !Array.isArray(value);
}

function isChoice(key: keyof Settings, value: unknown): boolean {
  const choices = CHOICES[key];
  // Not `in`: "toString" is no theme.
  return choices === undefined ? typeof value === 'boolean' : typeof value === 'string' && Object.hasOwn(choices, value);
}

function readLayers(value: unknown, faults: string[]): Settings['layers'] {
  const layers = { ...DEFAULT_SETTINGS.layers };
  if (value === undefined) return layers;
  if (!isRecord(value)) {
    faults.push('layers');
    return layers;
  }
  for (const name of Object.keys(layers) as LayerName[]) {
    const shown = value[name];
    if (typeof shown === 'boolean') layers[name] = shown;
    else if (shown !== undefined) faults.push(`layers.${name}`);
  }
  return layers;
}

/** Reads what was parsed from storage or a file. A field that is absent or bad has its default; the bad ones are named. */
export function readSettings(value: unknown): ReadSettings {
  if (!isRecord(value)) return { settings: defaults(), faults: ['not settings of this page'] };
  const { version } = value;
  if (typeof version !== 'number' || !Number.isInteger(version) || version < 1) {
    return { settings: defaults(), faults: ['no version'] };
  }
  // A newer page may have added fields and choices; those that are known still count.
  const faults: string[] = version > SETTINGS_VERSION ? [`version ${version} is newer than this page`] : [];
  const settings = defaults();
  for (const key of Object.keys(settings) as (keyof Settings)[]) {
    if (key === 'layers' || value[key] === undefined) continue;
    if (isChoice(key, value[key])) Object.assign(settings, { [key]: value[key] });
    else faults.push(key);
  }
  settings.layers = readLayers(value['layers'], faults);
  return { settings, faults };
}

/** Reads a text. Throws nothing: what is not JSON is a fault. */
export function parseSettings(text: string): ReadSettings {
  let value: unknown;
  try {
    value = JSON.parse(text);
  } catch {
    return { settings: defaults(), faults: ['not JSON'] };
  }
  return readSettings(value);
}

/** What pages before the settings kept: the coordinate format and the layers, without a version. */
export function parseOldPreferences(text: string): ReadSettings {
  const { settings, faults } = parseSettings(text);
  if (faults[0] !== 'no version') return { settings, faults };
  const { format, layers } = JSON.parse(text) as Record<string, unknown>;
  return readSettings({ version: SETTINGS_VERSION, format, layers });
}

export function writeSettings(settings: Settings): string {
  return JSON.stringify({ version: SETTINGS_VERSION, ...settings }, null, 2);
}

export function defaults(): Settings {
  return { ...DEFAULT_SETTINGS, layers: { ...DEFAULT_SETTINGS.layers } };
}
