/** Numbers and coordinates in the words an operator reads. Pure; a missing or non-finite value is a dash. */

import type { LatLon } from './earth';
import { geodeticFromMgrs, mgrsFromGeodetic, parseUtm, utmFromGeodetic } from './utm';

export type Quantity = number | null | undefined;
export type CoordinateFormat = 'dd' | 'dm' | 'dms' | 'mgrs' | 'utm';

export const COORDINATE_FORMATS: Record<CoordinateFormat, string> = {
  dd: 'Decimal degrees',
  dm: 'Degrees, minutes',
  dms: 'Degrees, minutes, seconds',
  mgrs: 'MGRS',
  utm: 'UTM',
};

export const DASH = '–';

function known(value: Quantity): value is number {
  return typeof value === 'number' && Number.isFinite(value);
}

export function formatNumber(value: Quantity, digits = 0): string {
  if (!known(value)) return DASH;
  const text = value.toFixed(digits);
  return /^-0(\.0*)?$/.test(text) ? text.slice(1) : text.replace('-', '−');
}

export function withUnit(value: Quantity, unit: string, digits = 0): string {
  return known(value) ? `${formatNumber(value, digits)} ${unit}` : DASH;
}

/** 0 to 359, three digits, as a heading is spoken. */
export function formatHeading(heading_deg: Quantity): string {
  if (!known(heading_deg)) return '–––';
  const whole = ((Math.round(heading_deg) % 360) + 360) % 360;
  return whole.toString().padStart(3, '0');
}

/** Age of something: "0.4 s", "12 s", "3 min 05 s", "2 h 04 min". */
export function formatAge(age_s: Quantity): string {
  if (!known(age_s)) return DASH;
  const s = Math.max(0, age_s);
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 59.5) return `${Math.round(s)} s`;
  const whole = Math.round(s);
  if (whole < 3600) return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, '0')} s`;
  return `${Math.floor(whole / 3600)} h ${String(Math.floor((whole % 3600) / 60)).padStart(2, '0')} min`;
}

/** "4:07" or "1:04:07". */
export function formatClock(seconds: Quantity): string {
  if (!known(seconds)) return '–:––';
  const whole = Math.max(0, Math.floor(seconds));
  const minutes = Math.floor(whole / 60) % 60;
  const rest = String(whole % 60).padStart(2, '0');
  const hours = Math.floor(whole / 3600);
  return hours > 0 ? `${hours}:${String(minutes).padStart(2, '0')}:${rest}` : `${minutes}:${rest}`;
}

export function formatBytes(bytes: Quantity): string {
  if (!known(bytes)) return DASH;
  const units = ['B', 'kB', 'MB', 'GB', 'TB'];
  let value = Math.max(0, bytes);
  let unit = 0;
  while (value >= 1000 && unit < units.length - 1) {
    value /= 1000;
    unit++;
  }
  return `${value.toFixed(unit === 0 || value >= 100 ? 0 : 1)} ${units[unit]}`;
}

export function formatUtcTime(t_unix_us: Quantity): string {
  if (!known(t_unix_us)) return DASH;
  return `${new Date(t_unix_us / 1000).toISOString().slice(11, 19)}Z`;
}

export function formatUtcDate(t_unix_us: Quantity): string {
  if (!known(t_unix_us)) return DASH;
  const iso = new Date(t_unix_us / 1000).toISOString();
  return `${iso.slice(0, 10)} ${iso.slice(11, 16)}Z`;
}

function degreesMinutes(value: number, width: number, positive: string, negative: string): string {
  const steps = Math.round(Math.abs(value) * 600_000);
  const min = (steps % 600_000) / 10_000;
  return `${String(Math.floor(steps / 600_000)).padStart(width, '0')}°${min.toFixed(4).padStart(7, '0')}′${value < 0 ? negative : positive}`;
}

function sexagesimal(value: number, width: number, positive: string, negative: string): string {
  const tenths = Math.round(Math.abs(value) * 36_000);
  const deg = Math.floor(tenths / 36_000);
  const min = Math.floor((tenths % 36_000) / 600);
  const sec = (tenths % 600) / 10;
  return (
    `${String(deg).padStart(width, '0')}°${String(min).padStart(2, '0')}′` +
    `${sec.toFixed(1).padStart(4, '0')}″${value < 0 ? negative : positive}`
  );
}

export function formatCoordinate(at: LatLon | null, format: CoordinateFormat): string {
  if (!at || !known(at.lat_deg) || !known(at.lon_deg)) return DASH;
  switch (format) {
    case 'dd':
      return `${formatNumber(at.lat_deg, 6)}, ${formatNumber(at.lon_deg, 6)}`;
    case 'dm':
      return `${degreesMinutes(at.lat_deg, 2, 'N', 'S')} ${degreesMinutes(at.lon_deg, 3, 'E', 'W')}`;
    case 'dms':
      return `${sexagesimal(at.lat_deg, 2, 'N', 'S')} ${sexagesimal(at.lon_deg, 3, 'E', 'W')}`;
    case 'mgrs':
      return mgrsFromGeodetic(at) ?? DASH;
    case 'utm': {
      const utm = utmFromGeodetic(at);
      return utm ? `${utm.zone}${utm.band} ${utm.easting_m.toFixed(0)} ${utm.northing_m.toFixed(0)}` : DASH;
    }
  }
}

/** The station's grid reference with the gaps that make it readable. */
export function formatMgrs(mgrs: string | null | undefined): string {
  const match = /^(\d{0,2}[A-Z])([A-Z]{2})((?:\d\d)*)$/.exec(mgrs?.replaceAll(' ', '') ?? '');
  if (!match) return mgrs || DASH;
  const [, zone, square, digits] = match as unknown as [string, string, string, string];
  const half = digits.length / 2;
  return [zone, square, digits.slice(0, half), digits.slice(half)].filter(Boolean).join(' ');
}

/** Reads "58.41, 15.62", "58.41N 15.62E", degrees and minutes, with or without seconds, UTM, or MGRS. Null when it is none of them. */
export function parseCoordinate(text: string): LatLon | null {
  const trimmed = text.trim().replaceAll('−', '-');
  const grid = geodeticFromMgrs(trimmed) ?? parseUtm(trimmed);
  if (grid) return grid;
  const angle = String.raw`([+-]?\d+(?:\.\d+)?)\s*°?\s*(?:(\d+(?:\.\d+)?)\s*['′]\s*)?(?:(\d+(?:\.\d+)?)\s*["″]\s*)?`;
  const match = new RegExp(`^${angle}([NS])?\\s*[,;\\s]\\s*${angle}([EW])?$`, 'i').exec(trimmed);
  if (!match) return null;
  const value = (deg: string, min: string | undefined, sec: string | undefined, side: string | undefined) => {
    const size = Math.abs(Number(deg)) + Number(min ?? 0) / 60 + Number(sec ?? 0) / 3600;
    return deg.startsWith('-') || /[SW]/i.test(side ?? '') ? -size : size;
  };
  const lat_deg = value(match[1]!, match[2], match[3], match[4]);
  const lon_deg = value(match[5]!, match[6], match[7], match[8]);
  return Math.abs(lat_deg) <= 90 && Math.abs(lon_deg) <= 180 ? { lat_deg, lon_deg } : null;
}
