/** Everything the page knows, as a fold over the station's messages. Pure: `state = reduce(state, message)`. */

import type {
  AidingMessage,
  AckMessage,
  Alarm,
  FixMessage,
  GpsMessage,
  HomingMessage,
  LandingMessage,
  LinkMessage,
  MapSummary,
  Recording,
  ReplayMessage,
  StateMessage,
  StationMessage,
  Target,
  TelemetryMessage,
  VehicleSummary,
  VideoMessage,
} from '../api/types';

const ALARMS_KEPT = 200;
const ACKS_KEPT = 20;

export interface AlarmEntry extends Alarm {
  raised_unix_us: number;
  cleared_unix_us: number | null;
}

export interface Vehicle {
  id: string;
  summary: VehicleSummary | null;
  state: StateMessage | null;
  gps: GpsMessage | null;
  telemetry: TelemetryMessage | null;
  link: LinkMessage | null;
  video: VideoMessage | null;
  fix: FixMessage | null;
  fixesAccepted: number;
  fixesRejected: number;
  replay: ReplayMessage | null;
  landing: LandingMessage | null;
  homing: HomingMessage | null;
  aiding: AidingMessage | null;
}

export interface Mission {
  /** Null until the station said hello. */
  station: { name: string; version: string; data_dir_free_bytes: number } | null;
  vehicles: Record<string, Vehicle>;
  maps: MapSummary[];
  targets: Record<string, Target>;
  /** Newest first. */
  alarms: AlarmEntry[];
  acks: AckMessage[];
  recording: Recording;
  /** Flights that are being read for a replay, and how far, 0 to 1. */
  preparing: Record<string, number>;
  waiting_for: string[];
  /** Goes up whenever the landing pad may be another one. */
  padRevision: number;
  /** Of the pad that is looked for; undefined where the station does not say. */
  padName: string | null | undefined;
}

export const NO_MISSION: Mission = {
  station: null,
  vehicles: {},
  maps: [],
  targets: {},
  alarms: [],
  acks: [],
  recording: { active: false, flight_id: null },
  preparing: {},
  waiting_for: [],
  padRevision: 0,
  padName: undefined,
};

export function newVehicle(id: string, summary: VehicleSummary | null = null): Vehicle {
  return {
    id,
    summary,
    state: null,
    gps: null,
    telemetry: null,
    link: null,
    video: null,
    fix: null,
    fixesAccepted: 0,
    fixesRejected: 0,
    replay: null,
    landing: null,
    homing: null,
    aiding: null,
  };
}

export function isReplay(vehicle_id: string): boolean {
  return vehicle_id.startsWith('replay-');
}

export function videoSourceOf(vehicle: Vehicle): string {
  return vehicle.video?.source ?? `cam-${vehicle.id}`;
}

/** A source names its vehicle where the message does not. */
export function videoVehicle(message: VideoMessage): string {
  return message.vehicle_id ?? message.source.replace(/^cam-/, '');
}

export function activeAlarms(mission: Mission): AlarmEntry[] {
  return mission.alarms.filter((alarm) => alarm.active);
}

function withVehicle(mission: Mission, id: string, change: Partial<Vehicle>): Mission {
  const before = mission.vehicles[id] ?? newVehicle(id);
  return { ...mission, vehicles: { ...mission.vehicles, [id]: { ...before, ...change } } };
}

function without<T>(record: Record<string, T>, id: string): Record<string, T> {
  const { [id]: _gone, ...rest } = record;
  return rest;
}

function identity(value: string | { id: string }): string {
  return typeof value === 'string' ? value : value.id;
}

function alarmEntry(alarm: Alarm, t_unix_us: number, before: AlarmEntry | undefined): AlarmEntry {
  return {
    id: alarm.id,
    vehicle_id: alarm.vehicle_id,
    severity: alarm.severity,
    code: alarm.code,
    text: alarm.text,
    active: alarm.active,
    raised_unix_us: alarm.since_unix_us ?? before?.raised_unix_us ?? t_unix_us,
    cleared_unix_us: alarm.active ? null : (before?.cleared_unix_us ?? t_unix_us),
  };
}

function withAlarm(alarms: AlarmEntry[], alarm: Alarm, t_unix_us: number): AlarmEntry[] {
  const before = alarms.find((entry) => entry.id === alarm.id);
  const entry = alarmEntry(alarm, t_unix_us, before);
  if (before) return alarms.map((other) => (other === before ? entry : other));
  return [entry, ...alarms].slice(0, ALARMS_KEPT);
}

/**
 * Hello is the whole truth about the station: what it does not name is gone. Vehicles keep what they last said, so that
 * a short interruption does not blank the page; alarms keep their history, and those no longer named are cleared.
 */
function greeted(mission: Mission, hello: Extract<StationMessage, { type: 'hello' }>): Mission {
  const named = new Set(hello.alarms.map((alarm) => alarm.id));
  let alarms = mission.alarms.map((entry) =>
    entry.active && !named.has(entry.id) ? { ...entry, active: false, cleared_unix_us: hello.t_unix_us } : entry,
  );
  for (const alarm of hello.alarms) alarms = withAlarm(alarms, alarm, hello.t_unix_us);
  return {
    ...mission,
    station: hello.station,
    vehicles: Object.fromEntries(
      hello.vehicles.map((summary) => [
        summary.id,
        { ...(mission.vehicles[summary.id] ?? newVehicle(summary.id)), summary },
      ]),
    ),
    maps: hello.maps,
    targets: Object.fromEntries(hello.targets.features.map((target) => [target.id, target])),
    alarms,
    recording: hello.recording,
    preparing: {},
    waiting_for: hello.waiting_for,
    padRevision: mission.padRevision + 1,
    padName: hello.pad,
  };
}

export function reduce(mission: Mission, message: StationMessage): Mission {
  switch (message.type) {
    case 'hello':
      return greeted(mission, message);
    case 'state': {
      const before = mission.vehicles[message.vehicle_id];
      const seek = before?.state != null && before.state.epoch !== message.epoch;
      return withVehicle(mission, message.vehicle_id, seek ? { state: message, fix: null } : { state: message });
    }
    case 'gps':
      return withVehicle(mission, message.vehicle_id, { gps: message });
    case 'telemetry':
      return withVehicle(mission, message.vehicle_id, { telemetry: message });
    case 'link':
      return withVehicle(mission, message.vehicle_id, { link: message });
    case 'video':
      return withVehicle(mission, videoVehicle(message), { video: message });
    case 'fix': {
      const before = mission.vehicles[message.vehicle_id] ?? newVehicle(message.vehicle_id);
      return withVehicle(mission, message.vehicle_id, {
        fix: message,
        fixesAccepted: before.fixesAccepted + (message.accepted ? 1 : 0),
        fixesRejected: before.fixesRejected + (message.accepted ? 0 : 1),
      });
    }
    case 'replay': {
      const { flight_id } = message;
      const preparing = flight_id in mission.preparing ? without(mission.preparing, flight_id) : mission.preparing;
      return { ...withVehicle(mission, message.vehicle_id, { replay: message }), preparing };
    }
    case 'replay_preparing':
      return { ...mission, preparing: { ...mission.preparing, [message.flight_id]: message.progress } };
    case 'vehicle': {
      const id = identity(message.vehicle);
      if (message.action === 'deleted') return { ...mission, vehicles: without(mission.vehicles, id) };
      return withVehicle(mission, id, typeof message.vehicle === 'string' ? {} : { summary: message.vehicle });
    }
    case 'target':
      return {
        ...mission,
        targets:
          message.action === 'deleted'
            ? without(mission.targets, identity(message.target))
            : withTarget(mission.targets, message.target),
      };
    case 'sighting': {
      const target = mission.targets[message.target_id];
      if (!target) return mission;
      const { lat_deg, lon_deg, alt_amsl_m, ce90_m, ellipse95, track } = message;
      // What was stopped meanwhile stays so; the version is that of the next 'target'.
      if (target.properties.track?.status === 'stopped') return mission;
      const properties = { ...target.properties, lat_deg, lon_deg, alt_amsl_m, ce90_m, ellipse95, track };
      return { ...mission, targets: { ...mission.targets, [target.id]: { ...target, properties } } };
    }
    case 'alarm':
      return { ...mission, alarms: withAlarm(mission.alarms, message, message.t_unix_us) };
    case 'ack':
      return { ...mission, acks: [message, ...mission.acks].slice(0, ACKS_KEPT) };
    case 'map':
      return { ...mission, maps: withMap(mission.maps, message) };
    case 'recording': {
      const { active, flight_id, duration_s, bytes } = message;
      return { ...mission, recording: { active, flight_id, duration_s: duration_s ?? null, bytes: bytes ?? null } };
    }
    case 'landing':
      return withVehicle(mission, message.vehicle_id, { landing: message });
    case 'homing':
      return withVehicle(mission, message.vehicle_id, { homing: message });
    case 'aiding':
      return withVehicle(mission, message.vehicle_id, { aiding: message });
    case 'pad':
      return { ...mission, padRevision: mission.padRevision + 1, padName: message.name };
    case 'waiting':
      return { ...mission, waiting_for: message.waiting_for };
    case 'plan':
    case 'pong':
      return mission;
    default:
      // A newer station may say more than this page understands.
      return mission;
  }
}

/** An answer over REST and the message on the socket race: the higher version wins. */
export function withTarget(targets: Record<string, Target>, target: Target): Record<string, Target> {
  const before = targets[target.id];
  if (before && before.properties.version > target.properties.version) return targets;
  return { ...targets, [target.id]: target };
}

function withMap(maps: MapSummary[], message: Extract<StationMessage, { type: 'map' }>): MapSummary[] {
  if (message.action === 'deleted') {
    const id = identity(message.map);
    return maps.filter((map) => map.id !== id);
  }
  const { map } = message;
  return maps.some((other) => other.id === map.id)
    ? maps.map((other) => (other.id === map.id ? map : other))
    : [...maps, map];
}
