/** UTM and MGRS from geodetic coordinates, to show and to read. Krueger's series to n^3: below 1 mm in a zone. Pure. */

import { WGS84_A_M, WGS84_F, type LatLon } from './earth';

const N = WGS84_F / (2 - WGS84_F);
const RECTIFYING_M = (WGS84_A_M / (1 + N)) * (1 + N ** 2 / 4 + N ** 4 / 64);
const ALPHA = [N / 2 - (2 * N ** 2) / 3 + (5 * N ** 3) / 16, (13 * N ** 2) / 48 - (3 * N ** 3) / 5, (61 * N ** 3) / 240];
const BETA = [N / 2 - (2 * N ** 2) / 3 + (37 * N ** 3) / 96, N ** 2 / 48 + N ** 3 / 15, (17 * N ** 3) / 480];
const DELTA = [2 * N - (2 * N ** 2) / 3 - 2 * N ** 3, (7 * N ** 2) / 3 - (8 * N ** 3) / 5, (56 * N ** 3) / 15];
const SCALE = 0.9996;
const FALSE_EASTING_M = 500_000;
const FALSE_NORTHING_M = 10_000_000;
const BANDS = 'CDEFGHJKLMNPQRSTUVWX';
const COLUMNS = ['ABCDEFGH', 'JKLMNPQR', 'STUVWXYZ'];
const ROWS = 'ABCDEFGHJKLMNPQRSTUV';

export interface Utm {
  zone: number;
  band: string;
  easting_m: number;
  northing_m: number;
}

/** The zone with its exceptions in south-west Norway and Svalbard; null near the poles. */
export function utmZone(at: LatLon): { zone: number; band: string } | null {
  const { lat_deg, lon_deg } = at;
  if (!(lat_deg >= -80 && lat_deg <= 84) || !Number.isFinite(lon_deg)) return null;
  const lon = ((((lon_deg + 180) % 360) + 360) % 360) - 180;
  const band = BANDS[Math.min(Math.floor((lat_deg + 80) / 8), BANDS.length - 1)]!;
  let zone = Math.floor((lon + 180) / 6) + 1;
  if (band === 'V' && lon >= 3 && lon < 12) zone = 32;
  if (band === 'X' && lon >= 0 && lon < 42) zone = lon < 9 ? 31 : lon < 21 ? 33 : lon < 33 ? 35 : 37;
  return { zone, band };
}

export function utmFromGeodetic(at: LatLon): Utm | null {
  const where = utmZone(at);
  if (!where) return null;
  const lat = (at.lat_deg * Math.PI) / 180;
  const lon = ((at.lon_deg - (where.zone * 6 - 183)) * Math.PI) / 180;
  const k = (2 * Math.sqrt(N)) / (1 + N);
  const t = Math.sinh(Math.atanh(Math.sin(lat)) - k * Math.atanh(k * Math.sin(lat)));
  const xi = Math.atan2(t, Math.cos(lon));
  const eta = Math.atanh(Math.sin(lon) / Math.hypot(1, t));
  let x = eta;
  let y = xi;
  ALPHA.forEach((a, i) => {
    const j = 2 * (i + 1);
    x += a * Math.cos(j * xi) * Math.sinh(j * eta);
    y += a * Math.sin(j * xi) * Math.cosh(j * eta);
  });
  return {
    ...where,
    easting_m: FALSE_EASTING_M + SCALE * RECTIFYING_M * x,
    northing_m: (at.lat_deg < 0 ? FALSE_NORTHING_M : 0) + SCALE * RECTIFYING_M * y,
  };
}

export function geodeticFromUtm(utm: Utm): LatLon {
  const south = utm.band < 'N';
  const xi = (utm.northing_m - (south ? FALSE_NORTHING_M : 0)) / (SCALE * RECTIFYING_M);
  const eta = (utm.easting_m - FALSE_EASTING_M) / (SCALE * RECTIFYING_M);
  let xiPrime = xi;
  let etaPrime = eta;
  BETA.forEach((b, i) => {
    const j = 2 * (i + 1);
    xiPrime -= b * Math.sin(j * xi) * Math.cosh(j * eta);
    etaPrime -= b * Math.cos(j * xi) * Math.sinh(j * eta);
  });
  const chi = Math.asin(Math.sin(xiPrime) / Math.cosh(etaPrime));
  let lat = chi;
  DELTA.forEach((d, i) => {
    lat += d * Math.sin(2 * (i + 1) * chi);
  });
  const lon = Math.atan2(Math.sinh(etaPrime), Math.cos(xiPrime));
  return { lat_deg: (lat * 180) / Math.PI, lon_deg: utm.zone * 6 - 183 + (lon * 180) / Math.PI };
}

/** MGRS with 1 to 5 digits an axis (5: one metre). Truncates, as the grid does. Null near the poles. */
export function mgrsFromGeodetic(at: LatLon, digits = 5): string | null {
  const utm = utmFromGeodetic(at);
  if (!utm) return null;
  const column = COLUMNS[(utm.zone - 1) % 3]![Math.floor(utm.easting_m / 100_000) - 1];
  const row = ROWS[(Math.floor(utm.northing_m / 100_000) + (utm.zone % 2 === 0 ? 5 : 0)) % 20];
  if (column === undefined || row === undefined) return null;
  const cell = 10 ** (5 - digits);
  const part = (metres: number) =>
    Math.floor((metres % 100_000) / cell)
      .toString()
      .padStart(digits, '0');
  return `${utm.zone}${utm.band} ${column}${row} ${part(utm.easting_m)} ${part(utm.northing_m)}`;
}

/** Reads MGRS with or without spaces; the centre of the cell it names. Null when it is none. */
export function geodeticFromMgrs(text: string): LatLon | null {
  const match = /^(\d{1,2})([C-HJ-NP-X])([A-HJ-NP-Z])([A-HJ-NP-V])((?:\d\d){1,5})$/.exec(
    text.toUpperCase().replace(/\s+/g, ''),
  );
  if (!match) return null;
  const zone = Number(match[1]);
  const band = match[2]!;
  const column = (COLUMNS[(zone - 1) % 3] ?? '').indexOf(match[3]!);
  const row = (ROWS.indexOf(match[4]!) - (zone % 2 === 0 ? 5 : 0) + 20) % 20;
  if (zone < 1 || zone > 60 || column < 0) return null;
  const digits = match[5]!.length / 2;
  const cell = 10 ** (5 - digits);
  const easting_m = (column + 1) * 100_000 + (Number(match[5]!.slice(0, digits)) + 0.5) * cell;
  const within_m = row * 100_000 + (Number(match[5]!.slice(digits)) + 0.5) * cell;
  // Rows repeat every 2000 km: take the repetition that lies in the latitude band.
  const first_deg = BANDS.indexOf(band) * 8 - 80;
  for (let k = 0; k < 5; k++) {
    const at = geodeticFromUtm({ zone, band, easting_m, northing_m: within_m + k * 2_000_000 });
    if (at.lat_deg > first_deg - 1.5 && at.lat_deg < first_deg + (band === 'X' ? 13.5 : 9.5)) return at;
  }
  return null;
}

/** Reads "33V 536309 6474615". Null when it is none, or lies outside its zone and band. */
export function parseUtm(text: string): LatLon | null {
  const match = /^(\d{1,2})([C-HJ-NP-X])\s+(\d{6}(?:\.\d+)?)\s*(?:M?E)?\s*,?\s+(\d{1,8}(?:\.\d+)?)\s*(?:M?N)?$/.exec(text.trim().toUpperCase());
  if (!match) return null;
  const zone = Number(match[1]);
  if (zone < 1 || zone > 60) return null;
  const at = geodeticFromUtm({ zone, band: match[2]!, easting_m: Number(match[3]), northing_m: Number(match[4]) });
  // A band that does not fit the northing is a slip of the pen; half a degree beyond its edge is not.
  const first_deg = BANDS.indexOf(match[2]!) * 8 - 80;
  return at.lat_deg > first_deg - 0.5 && at.lat_deg < first_deg + (match[2] === 'X' ? 12.5 : 8.5) ? at : null;
}
