import { describe, expect, it } from 'vitest';
import stored from '../../../tests/authorities/grid_mgrs.json?raw';
import { distanceM } from './earth';
import { geodeticFromMgrs, geodeticFromUtm, mgrsFromGeodetic, utmFromGeodetic, utmZone } from './utm';

// pyproj 3 (proj=utm, ellps=WGS84) and the mgrs package, which wraps GeoTrans; both zone exceptions are among them.
const AUTHORITY: [lat: number, lon: number, zone: number, easting: number, northing: number, mgrs: string][] = [
  [58.4108, 15.6214, 33, 536308.536, 6474614.999, '33VWE3630874614'],
  [-33.9249, 18.4241, 34, 261881.599, 6243182.355, '34HBH6188143182'],
  [0.0001, -78.5, 17, 778276.317, 11.064, '17NQA7827600011'],
  [60.3913, 5.3221, 32, 297353.933, 6700648.345, '32VKN9735300648'],
  [78.2232, 15.6267, 33, 514278.715, 8683355.469, '33XWG1427883355'],
  [-0.0003, 33.2, 36, 522255.038, 9999966.841, '36MWE2225599966'],
  [40.7128, -74.006, 18, 583959.372, 4507350.998, '18TWL8395907350'],
  [35.6762, 139.6503, 54, 377855.776, 3948874.392, '54SUE7785548874'],
];

describe.each(AUTHORITY)('at %s, %s', (lat_deg, lon_deg, zone, easting_m, northing_m, mgrs) => {
  const at = { lat_deg, lon_deg };

  it('gives the same UTM to a millimetre', () => {
    const utm = utmFromGeodetic(at)!;
    expect(utm.zone).toBe(zone);
    expect(Math.abs(utm.easting_m - easting_m)).toBeLessThan(0.002);
    expect(Math.abs(utm.northing_m - northing_m)).toBeLessThan(0.002);
  });

  it('comes back from UTM', () => {
    expect(distanceM(at, geodeticFromUtm(utmFromGeodetic(at)!))).toBeLessThan(0.002);
  });

  it('gives the same MGRS', () => {
    expect(mgrsFromGeodetic(at)?.replaceAll(' ', '')).toBe(mgrs);
  });

  it('reads MGRS to the centre of its square metre', () => {
    expect(distanceM(at, geodeticFromMgrs(mgrs.toLowerCase())!)).toBeLessThan(0.72);
  });
});

describe('mgrs', () => {
  it('shows fewer digits on demand', () => {
    expect(mgrsFromGeodetic({ lat_deg: 58.4108, lon_deg: 15.6214 }, 4)).toBe('33V WE 3630 7461');
  });

  it('refuses what is none', () => {
    for (const text of ['', 'hello', '33V WE 363 7461', '99V WE 36308 74614', '33I WE 36308 74614', '33V AE 36308 74614']) {
      expect(geodeticFromMgrs(text)).toBeNull();
    }
  });

  it('has no answer at the poles or for nonsense', () => {
    expect(utmZone({ lat_deg: 86, lon_deg: 0 })).toBeNull();
    expect(mgrsFromGeodetic({ lat_deg: NaN, lon_deg: 0 })).toBeNull();
  });
});

interface GridPlace {
  lat_deg: number;
  lon_deg: number;
  mgrs: string;
  mgrs_100_m: string;
}

const GRID = JSON.parse(stored) as { places: GridPlace[] };

describe('grid references all over the world', () => {
  it('are those of GeoTrans', () => {
    expect(GRID.places.length).toBeGreaterThan(200);
    // GeoTrans writes zones below ten with a zero in front.
    const own = (at: GridPlace, digits: number) => mgrsFromGeodetic(at, digits)?.replaceAll(' ', '').padStart(5 + 2 * digits, '0');
    expect(GRID.places.map((at) => own(at, 5))).toEqual(GRID.places.map((at) => at.mgrs));
    expect(GRID.places.map((at) => own(at, 3))).toEqual(GRID.places.map((at) => at.mgrs_100_m));
  });

  it('are read back to within their cell', () => {
    for (const at of GRID.places) expect(distanceM(at, geodeticFromMgrs(at.mgrs)!)).toBeLessThan(0.75);
  });
});
