import { describe, expect, it } from 'vitest';
import {
  formatAge,
  formatBytes,
  formatClock,
  formatCoordinate,
  formatHeading,
  formatMgrs,
  formatNumber,
  formatUtcDate,
  formatUtcTime,
  parseCoordinate,
  withUnit,
} from './format';

const at = { lat_deg: 58.4108, lon_deg: -15.6214 };

describe('numbers', () => {
  it('shows a dash for what is not known', () => {
    expect([formatNumber(null), formatNumber(NaN), withUnit(undefined, 'm'), formatAge(null)]).toEqual(['–', '–', '–', '–']);
  });

  it('has a true minus and no negative zero', () => {
    expect([formatNumber(-3.26, 1), formatNumber(-0.04, 1), withUnit(12.34, 'm', 1)]).toEqual(['−3.3', '0.0', '12.3 m']);
  });

  it('speaks headings in three digits', () => {
    expect([formatHeading(7.2), formatHeading(359.7), formatHeading(-90)]).toEqual(['007', '000', '270']);
  });

  it('speaks ages', () => {
    expect([0.42, 9.97, 42.4, 185, 7440].map(formatAge)).toEqual(['0.4 s', '10 s', '42 s', '3 min 05 s', '2 h 04 min']);
  });

  it('speaks clocks, sizes and times', () => {
    expect([formatClock(247), formatClock(3847), formatClock(null)]).toEqual(['4:07', '1:04:07', '–:––']);
    expect([formatBytes(950), formatBytes(12_340_000), formatBytes(4.2e11)]).toEqual(['950 B', '12.3 MB', '420 GB']);
    expect(formatUtcTime(1_760_000_000_000_000)).toBe('08:53:20Z');
    expect(formatUtcDate(1_760_000_000_000_000)).toBe('2025-10-09 08:53Z');
  });
});

describe('coordinates', () => {
  it('shows each format', () => {
    expect(formatCoordinate(at, 'dd')).toBe('58.410800, −15.621400');
    expect(formatCoordinate(at, 'dm')).toBe('58°24.6480′N 015°37.2840′W');
    expect(formatCoordinate(at, 'dms')).toBe('58°24′38.9″N 015°37′17.0″W');
    expect(formatCoordinate({ lat_deg: 58.4108, lon_deg: 15.6214 }, 'mgrs')).toBe('33V WE 36308 74614');
    expect(formatCoordinate({ lat_deg: 58.4108, lon_deg: 15.6214 }, 'utm')).toBe('33V 536309 6474615');
    expect(formatCoordinate(null, 'dd')).toBe('–');
  });

  it.each(['dd', 'dm', 'dms', 'mgrs', 'utm'] as const)('reads back what it shows as %s', (format) => {
    const read = parseCoordinate(formatCoordinate(at, format))!;
    expect(read.lat_deg).toBeCloseTo(at.lat_deg, 4);
    expect(read.lon_deg).toBeCloseTo(at.lon_deg, 4);
  });

  it('spaces a grid reference', () => {
    expect(formatMgrs('33VWE3630874614')).toBe('33V WE 36308 74614');
    expect([formatMgrs('33VWE'), formatMgrs(null), formatMgrs('odd')]).toEqual(['33V WE', '–', 'odd']);
  });

  it('carries the minutes that round up to a degree', () => {
    expect(formatCoordinate({ lat_deg: 9.9999999, lon_deg: -0.99999999 }, 'dm')).toBe('10°00.0000′N 001°00.0000′W');
  });

  it('refuses a UTM whose band contradicts its northing', () => {
    expect(parseCoordinate('33V 536309 6474615')!.lat_deg).toBeCloseTo(58.4108, 5);
    expect([parseCoordinate('33T 536309 6474615'), parseCoordinate('61V 536309 6474615')]).toEqual([null, null]);
  });

  it('reads usual spellings and refuses the rest', () => {
    expect(parseCoordinate('58.5N 15.25W')).toEqual({ lat_deg: 58.5, lon_deg: -15.25 });
    expect(parseCoordinate('-33.9249 18.4241')).toEqual({ lat_deg: -33.9249, lon_deg: 18.4241 });
    for (const text of ['', '12', 'north', '95, 10', '10, 190']) expect(parseCoordinate(text)).toBeNull();
  });
});
