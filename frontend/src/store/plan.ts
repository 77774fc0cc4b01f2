/**
 * A plan as QGroundControl writes it, and what is done to it on the page. Pure: every edit gives a new document, with all
 * that is not understood here kept as it was. Heights are metres above home where an item does not say otherwise.
 */

import type { LatLon } from '../geo/earth';

type Json = Record<string, unknown>;

export interface PlanDocument extends Json {
  mission: Json & { items: Json[] };
}

export const TAKEOFF = 22;
export const RETURN = 20;
const WAYPOINT = 16;
const LOITER_TIME = 19;
const CHANGE_SPEED = 178;
const JUMP = 177;
const RELATIVE = 3;
const MISSION_FRAME = 2;
/** What a path leads to; other commands with a place, such as regions of interest, are not drawn into it. */
const FLOWN = new Set([WAYPOINT, 17, 18, LOITER_TIME, 21, TAKEOFF, 31, 82, 84, 85]);

const NAMES: Record<number, string> = {
  16: 'Waypoint', 17: 'Stay', 18: 'Turns', 19: 'Stay for', 20: 'Return home', 21: 'Land', 22: 'Take off',
  31: 'Climb to', 82: 'Spline', 84: 'Take off',
  85: 'Land', 93: 'Wait', 177: 'Jump', 178: 'Speed', 189: 'Landing begins', 195: 'Look at', 201: 'Look at',
  206: 'Photo every', 2000: 'Photo',
};

export type Datum = 'home' | 'amsl' | 'ground';
const DATUMS: Record<number, Datum> = { 0: 'amsl', 5: 'amsl', 3: 'home', 6: 'home', 10: 'ground', 11: 'ground' };
export const DATUM_WORDS: Record<Datum, string> = { home: 'm above home', amsl: 'm AMSL', ground: 'm above ground' };

export interface PlanItem {
  /** In `mission.items`. */
  readonly index: number;
  /** As the station counts, from 1. */
  readonly number: number;
  readonly name: string;
  readonly command: number | null;
  readonly place: LatLon | null;
  readonly alt_m: number | null;
  readonly datum: Datum | null;
  /** Null where the command cannot stay. */
  readonly hold_s: number | null;
  /** Flown from here on; null where it does not change here. */
  readonly speed_m_s: number | null;
  readonly flown: boolean;
}

export interface Zone {
  readonly kind: 'polygon' | 'circle';
  /** In its own list of the document. */
  readonly index: number;
  readonly inclusion: boolean;
  readonly ring: LatLon[];
  readonly radius_m: number | null;
}

export interface RallyPoint extends LatLon {
  readonly alt_m: number;
}

export class PlanEditError extends Error {}

export function emptyPlan(home: LatLon | null, home_alt_m = 0): PlanDocument {
  return {
    fileType: 'Plan',
    version: 1,
    groundStation: 'Pilotage',
    mission: {
      version: 2, firmwareType: 0, vehicleType: 0, cruiseSpeed: 15, hoverSpeed: 5, globalPlanAltitudeMode: 1,
      ...(home ? { plannedHomePosition: [home.lat_deg, home.lon_deg, home_alt_m] } : {}),
      items: [],
    },
    geoFence: { version: 2, polygons: [], circles: [] },
    rallyPoints: { version: 2, points: [] },
  };
}

// --- what it holds ---

function params(item: Json): (number | null)[] {
  return Array.isArray(item.params) ? (item.params as (number | null)[]) : [];
}

/** How many items the station makes of an entry: a survey has its own inside. */
function counted(item: Json): number {
  const transect = item.TransectStyleComplexItem as { Items?: unknown[] } | undefined;
  return item.type === 'ComplexItem' ? (transect?.Items?.length ?? 0) : 1;
}

function speedAfter(items: readonly Json[], index: number): number | null {
  const next = items[index + 1];
  return next?.command === CHANGE_SPEED ? (params(next)[1] ?? null) : null;
}

export function itemsOf(plan: PlanDocument): PlanItem[] {
  let number = 1;
  return plan.mission.items.map((item, index) => {
    const here = number;
    number += counted(item);
    if (item.type === 'ComplexItem') {
      const name = `${String(item.complexItemType ?? 'Survey')} (${counted(item)} items)`;
      return { index, number: here, name, command: null, place: null, alt_m: null, datum: null, hold_s: null, speed_m_s: null, flown: false };
    }
    const command = Number(item.command);
    const values = params(item);
    const [lat_deg, lon_deg] = [values[4], values[5]];
    const datum = DATUMS[Number(item.frame)] ?? null;
    const placed = datum !== null && (FLOWN.has(command) || command === 195) && lat_deg != null && lon_deg != null && !(lat_deg === 0 && lon_deg === 0);
    return {
      index,
      number: here,
      name: NAMES[command] ?? `Command ${command}`,
      command,
      place: placed ? { lat_deg, lon_deg } : null,
      alt_m: datum !== null && FLOWN.has(command) ? (values[6] ?? null) : null,
      datum: FLOWN.has(command) ? datum : null,
      hold_s: command === WAYPOINT || command === LOITER_TIME ? (values[0] ?? 0) : null,
      speed_m_s: FLOWN.has(command) ? speedAfter(plan.mission.items, index) : null,
      flown: FLOWN.has(command),
    };
  });
}

/** What is listed: a change of speed is shown with the point that it follows. */
export function listedOf(plan: PlanDocument): PlanItem[] {
  const items = itemsOf(plan);
  return items.filter((item) => !(item.command === CHANGE_SPEED && items[item.index - 1]?.flown));
}

/** Points that the path leads through, in order. */
export function pointsOf(plan: PlanDocument): (PlanItem & { place: LatLon })[] {
  return itemsOf(plan).filter((item): item is PlanItem & { place: LatLon } => item.flown && item.place !== null);
}

function pair(value: unknown): LatLon {
  const [lat_deg, lon_deg] = value as [number, number];
  return { lat_deg, lon_deg };
}

function section(plan: PlanDocument, name: string): Json {
  return (plan[name] ?? {}) as Json;
}

function list(plan: PlanDocument, name: string, key: string): Json[] {
  return (section(plan, name)[key] ?? []) as Json[];
}

export function zonesOf(plan: PlanDocument): Zone[] {
  const polygons = list(plan, 'geoFence', 'polygons').map((zone, index): Zone => ({
    kind: 'polygon', index, inclusion: zone.inclusion === true, ring: (zone.polygon as unknown[]).map(pair), radius_m: null,
  }));
  const circles = list(plan, 'geoFence', 'circles').map((zone, index): Zone => {
    const circle = zone.circle as { center: unknown; radius: number };
    return { kind: 'circle', index, inclusion: zone.inclusion === true, ring: [pair(circle.center)], radius_m: circle.radius };
  });
  return [...polygons, ...circles];
}

export function rallyOf(plan: PlanDocument): RallyPoint[] {
  return (section(plan, 'rallyPoints').points as [number, number, number][] | undefined ?? []).map((point) => ({ ...pair(point), alt_m: point[2] }));
}

export function homeOf(plan: PlanDocument): LatLon | null {
  const home = plan.mission.plannedHomePosition;
  return Array.isArray(home) ? pair(home) : null;
}

export function cruiseOf(plan: PlanDocument): number {
  return typeof plan.mission.hoverSpeed === 'number' ? plan.mission.hoverSpeed : 5;
}

// --- what is done to it ---

function withItems(plan: PlanDocument, items: Json[]): PlanDocument {
  return { ...plan, mission: { ...plan.mission, items } };
}

function changed(plan: PlanDocument, index: number, change: (item: Json) => Json): PlanDocument {
  return withItems(plan, plan.mission.items.map((item, i) => (i === index ? change(item) : item)));
}

function withParam(item: Json, at: number, value: number | null): Json {
  const values = [...params(item)];
  values[at] = value;
  return { ...item, params: values };
}

/** Jumps name what they lead to by an id of its own, which no edit may change. */
function nextId(plan: PlanDocument): number {
  return plan.mission.items.reduce((most, item) => Math.max(most, Number(item.doJumpId) || 0, 0), plan.mission.items.length) + 1;
}

function made(plan: PlanDocument, command: number, frame: number, values: (number | null)[], id = nextId(plan)): Json {
  return { type: 'SimpleItem', autoContinue: true, command, doJumpId: id, frame, params: values };
}

function waypoint(plan: PlanDocument, at: LatLon, alt_m: number): Json {
  return made(plan, WAYPOINT, RELATIVE, [0, 0, 0, null, at.lat_deg, at.lon_deg, alt_m]);
}

function inserted(plan: PlanDocument, index: number, item: Json): PlanDocument {
  return withItems(plan, [...plan.mission.items.slice(0, index), item, ...plan.mission.items.slice(index)]);
}

/** A new point goes to the end, and before a return that stands there. */
export function addPoint(plan: PlanDocument, at: LatLon, alt_m: number): PlanDocument {
  const { items } = plan.mission;
  const end = items[items.length - 1]?.command === RETURN ? items.length - 1 : items.length;
  return inserted(plan, end, waypoint(plan, at, alt_m));
}

/** On the leg that leads to item `index`, with a height between those of its ends. */
export function insertPoint(plan: PlanDocument, index: number, at: LatLon): PlanDocument {
  const points = pointsOf(plan);
  const k = points.findIndex((point) => point.index === index);
  const heights = [points[k - 1]?.alt_m, points[k]?.alt_m].filter((alt): alt is number => alt != null);
  const alt_m = heights.length ? Math.round(heights.reduce((sum, alt) => sum + alt, 0) / heights.length) : 50;
  return inserted(plan, index, waypoint(plan, at, alt_m));
}

export function movePoint(plan: PlanDocument, index: number, at: LatLon): PlanDocument {
  return changed(plan, index, (item) => withParam(withParam(item, 4, at.lat_deg), 5, at.lon_deg));
}

/** Throws where a jump leads to it. A change of speed that belongs to it goes with it. */
export function removeItem(plan: PlanDocument, index: number): PlanDocument {
  const { items } = plan.mission;
  const count = items[index] && FLOWN.has(Number(items[index].command)) && speedAfter(items, index) !== null ? 2 : 1;
  const ids = items.slice(index, index + count).map((item) => item.doJumpId);
  const jump = items.find((item, i) => item.command === JUMP && i !== index && ids.includes(params(item)[0]));
  if (jump) throw new PlanEditError('A jump leads to this item: delete the jump first.');
  return withItems(plan, [...items.slice(0, index), ...items.slice(index + count)]);
}

export function setHeight(plan: PlanDocument, index: number, alt_m: number): PlanDocument {
  return changed(plan, index, (item) => {
    const known = withParam(item, 6, alt_m);
    // QGroundControl keeps the height as it was typed beside it.
    return 'Altitude' in known ? { ...known, Altitude: alt_m, AMSLAltAboveTerrain: null } : known;
  });
}

export function setHold(plan: PlanDocument, index: number, hold_s: number): PlanDocument {
  return changed(plan, index, (item) => withParam(item, 0, hold_s));
}

/** From this point on; null takes the change away. */
export function setSpeed(plan: PlanDocument, index: number, speed_m_s: number | null): PlanDocument {
  const { items } = plan.mission;
  const there = speedAfter(items, index) !== null;
  if (speed_m_s === null) return there ? removeItem(plan, index + 1) : plan;
  if (there) return changed(plan, index + 1, (item) => withParam(item, 1, speed_m_s));
  return inserted(plan, index + 1, made(plan, CHANGE_SPEED, MISSION_FRAME, [1, speed_m_s, -1, 0, 0, 0, 0]));
}

export function setCruise(plan: PlanDocument, speed_m_s: number): PlanDocument {
  return { ...plan, mission: { ...plan.mission, hoverSpeed: speed_m_s } };
}

export function addTakeoff(plan: PlanDocument, alt_m: number): PlanDocument {
  return inserted(plan, 0, made(plan, TAKEOFF, RELATIVE, [0, 0, 0, null, 0, 0, alt_m]));
}

export function addReturn(plan: PlanDocument): PlanDocument {
  return inserted(plan, plan.mission.items.length, made(plan, RETURN, MISSION_FRAME, [0, 0, 0, 0, 0, 0, 0]));
}

export function setHome(plan: PlanDocument, at: LatLon): PlanDocument {
  const before = plan.mission.plannedHomePosition;
  const alt_m = Array.isArray(before) ? Number(before[2]) : 0;
  return { ...plan, mission: { ...plan.mission, plannedHomePosition: [at.lat_deg, at.lon_deg, alt_m] } };
}

function withList(plan: PlanDocument, name: string, key: string, entries: unknown[]): PlanDocument {
  return { ...plan, [name]: { version: 2, ...(name === 'geoFence' ? { polygons: [], circles: [] } : {}), ...section(plan, name), [key]: entries } };
}

function zoneList(kind: Zone['kind']): 'polygons' | 'circles' {
  return kind === 'polygon' ? 'polygons' : 'circles';
}

export function addPolygon(plan: PlanDocument, inclusion: boolean, ring: readonly LatLon[]): PlanDocument {
  const polygon = ring.map((at) => [at.lat_deg, at.lon_deg]);
  return withList(plan, 'geoFence', 'polygons', [...list(plan, 'geoFence', 'polygons'), { inclusion, polygon, version: 1 }]);
}

export function addCircle(plan: PlanDocument, inclusion: boolean, centre: LatLon, radius_m: number): PlanDocument {
  const circle = { center: [centre.lat_deg, centre.lon_deg], radius: radius_m };
  return withList(plan, 'geoFence', 'circles', [...list(plan, 'geoFence', 'circles'), { inclusion, circle, version: 1 }]);
}

function changedZone(plan: PlanDocument, kind: Zone['kind'], index: number, change: (zone: Json) => Json): PlanDocument {
  const key = zoneList(kind);
  return withList(plan, 'geoFence', key, list(plan, 'geoFence', key).map((zone, i) => (i === index ? change(zone) : zone)));
}

/** A corner of a polygon, or the centre of a circle. */
export function moveCorner(plan: PlanDocument, kind: Zone['kind'], index: number, corner: number, at: LatLon): PlanDocument {
  const to = [at.lat_deg, at.lon_deg];
  return changedZone(plan, kind, index, (zone) =>
    kind === 'circle'
      ? { ...zone, circle: { ...(zone.circle as Json), center: to } }
      : { ...zone, polygon: (zone.polygon as unknown[]).map((before, i) => (i === corner ? to : before)) },
  );
}

export function insertCorner(plan: PlanDocument, index: number, corner: number, at: LatLon): PlanDocument {
  return changedZone(plan, 'polygon', index, (zone) => {
    const ring = zone.polygon as unknown[];
    return { ...zone, polygon: [...ring.slice(0, corner), [at.lat_deg, at.lon_deg], ...ring.slice(corner)] };
  });
}

/** A polygon of three corners that loses one is gone. */
export function removeCorner(plan: PlanDocument, index: number, corner: number): PlanDocument {
  const ring = list(plan, 'geoFence', 'polygons')[index]?.polygon as unknown[] | undefined;
  if (!ring || ring.length <= 3) return removeZone(plan, 'polygon', index);
  return changedZone(plan, 'polygon', index, (zone) => ({ ...zone, polygon: ring.filter((_, i) => i !== corner) }));
}

export function setRadius(plan: PlanDocument, index: number, radius_m: number): PlanDocument {
  return changedZone(plan, 'circle', index, (zone) => ({ ...zone, circle: { ...(zone.circle as Json), radius: radius_m } }));
}

export function setInclusion(plan: PlanDocument, kind: Zone['kind'], index: number, inclusion: boolean): PlanDocument {
  return changedZone(plan, kind, index, (zone) => ({ ...zone, inclusion }));
}

export function removeZone(plan: PlanDocument, kind: Zone['kind'], index: number): PlanDocument {
  const key = zoneList(kind);
  return withList(plan, 'geoFence', key, list(plan, 'geoFence', key).filter((_, i) => i !== index));
}

function withRally(plan: PlanDocument, change: (points: unknown[]) => unknown[]): PlanDocument {
  return withList(plan, 'rallyPoints', 'points', change((section(plan, 'rallyPoints').points ?? []) as unknown[]));
}

export function addRally(plan: PlanDocument, at: LatLon, alt_m: number): PlanDocument {
  return withRally(plan, (points) => [...points, [at.lat_deg, at.lon_deg, alt_m]]);
}

export function moveRally(plan: PlanDocument, index: number, at: LatLon): PlanDocument {
  return withRally(plan, (points) => points.map((point, i) => (i === index ? [at.lat_deg, at.lon_deg, (point as number[])[2]] : point)));
}

export function setRallyHeight(plan: PlanDocument, index: number, alt_m: number): PlanDocument {
  return withRally(plan, (points) => points.map((point, i) => (i === index ? [...(point as number[]).slice(0, 2), alt_m] : point)));
}

export function removeRally(plan: PlanDocument, index: number): PlanDocument {
  return withRally(plan, (points) => points.filter((_, i) => i !== index));
}
