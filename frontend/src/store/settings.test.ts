import { describe, expect, it } from 'vitest';
import { defaults, DEFAULT_SETTINGS, parseOldPreferences, parseSettings, readSettings, writeSettings, type Settings } from './settings';

const CHOSEN: Settings = {
  theme: 'sunlight',
  length: 'ft',
  speed: 'kn',
  format: 'mgrs',
  spokenAlarms: true,
  motion: 'reduced',
  layout: 'inset',
  videoLarge: true,
  sidePanel: false,
  instruments: false,
  layers: { imagery: false, gps: false, vision: true, ellipse: false, footprint: true, targets: false },
};

describe('settings', () => {
  it('come back as they were written', () => {
    expect(parseSettings(writeSettings(CHOSEN))).toEqual({ settings: CHOSEN, faults: [] });
  });

  it('have a default for what is absent, without a word', () => {
    expect(readSettings({ version: 1, theme: 'light' })).toEqual({ settings: { ...DEFAULT_SETTINGS, theme: 'light' }, faults: [] });
  });

  it.each([
    ['theme', 'pink'],
    ['theme', 'toString'],
    ['length', 'yd'],
    ['speed', 3],
    ['format', null],
    ['spokenAlarms', 'yes'],
    ['motion', []],
    ['layout', { split: true }],
    ['sidePanel', 0],
  ])('name a bad %s (%j) and keep the rest', (key, value) => {
    const { settings, faults } = readSettings({ ...JSON.parse(writeSettings(CHOSEN)), [key]: value });
    expect(faults).toEqual([key]);
    expect(settings).toEqual({ ...CHOSEN, [key]: DEFAULT_SETTINGS[key as keyof Settings] });
  });

  it('check each layer', () => {
    const { settings, faults } = readSettings({ version: 1, layers: { gps: false, vision: 'no', other: 1 } });
    expect(settings.layers).toEqual({ ...DEFAULT_SETTINGS.layers, gps: false });
    expect(faults).toEqual(['layers.vision']);
    expect(readSettings({ version: 1, layers: [true] }).faults).toEqual(['layers']);
  });

  it.each(['', 'null', '[]', '7', '{}', '{"version": "1"}', '{"version": 1.5}', '{'])('fall back whole for %j', (text) => {
    const { settings, faults } = parseSettings(text);
    expect(settings).toEqual(DEFAULT_SETTINGS);
    expect(faults).toHaveLength(1);
  });

  it('take what they know from a newer page, and say so', () => {
    const { settings, faults } = readSettings({ version: 2, theme: 'light', sound: 'loud' });
    expect([settings.theme, faults]).toEqual(['light', ['version 2 is newer than this page']]);
  });

  it('take over what older pages kept', () => {
    const { settings, faults } = parseOldPreferences('{"format":"utm","layers":{"gps":false}}');
    expect(faults).toEqual([]);
    expect(settings).toEqual({ ...DEFAULT_SETTINGS, format: 'utm', layers: { ...DEFAULT_SETTINGS.layers, gps: false } });
    expect(parseOldPreferences('{').faults).toEqual(['not JSON']);
  });

  it('are not shared through the defaults', () => {
    defaults().layers.gps = false;
    expect(DEFAULT_SETTINGS.layers.gps).toBe(true);
  });
});
