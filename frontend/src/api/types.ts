/**
 * What the station says on its sockets, by hand; what it says over REST comes from its own description (schema.d.ts).
 * Units are in the names; degrees, as everywhere at the edges.
 */

import type { components } from './schema';

type Schemas = components['schemas'];

export type Mode = 'gps' | 'vision' | 'dead_reckoning' | 'lost';
export type Severity = 'info' | 'caution' | 'warning';

/** The station turns NaN and infinity into null. */
export type Maybe<T> = T | null;

export type Ellipse95 = Schemas['EllipseBody'];

interface Envelope {
  seq: number;
  t_unix_us: number;
}

/** An older station, or one that has only just met the vehicle, may know less. */
export type VehicleSummary = Partial<Schemas['VehicleBody']> & { id: string };
export type MapBounds = Schemas['MapBounds'];
export type MapSummary = Schemas['MapBody'];
export type Matchability = Schemas['MatchabilityBody'];
export type Target = Schemas['TargetFeature'];
export type TargetProperties = Schemas['TargetProperties'];
export type TargetCollection = Schemas['TargetCollection'];
export type LocatedPixel = Schemas['LocatedPixel'];
export type Footprint = Schemas['FootprintBody'];
export type GroundKind = 'terrain' | 'flat';
/** What an operator points at: so far above the terrain, or above level ground at the height below the vehicle. */
export interface Pointing {
  height_above_ground_m: number;
  ground: GroundKind;
}
export type TargetTrack = Schemas['TrackBody'];
export type Command = Schemas['CommandBody'];
export type PlanPath = Schemas['PathFeature'];
export type PathProblem = Schemas['PathProblemBody'];
export type Flight = Schemas['FlightBody'];
export type Pad = Schemas['PadBody'];
export type Landing = Schemas['LandingBody'];
export type Homing = Schemas['HomingBody'];
export type HomingRequest = Schemas['HomingRequest'];
export type Way = Schemas['WayBody'];
/** What is not said is as the station has it. */
export type HomingWish = Pick<HomingRequest, 'action'> & Partial<Omit<HomingRequest, 'page'>>;
export type Aiding = Schemas['PositionAidingBody'];
export type AidingCheck = Schemas['AidingCheckBody'];
export type AidingForm = AidingCheck['form'];
export type PadSeen = Schemas['SeenBody'];
export type History = Schemas['HistoryBody'];
export type HistoryEvent = Schemas['HistoryEvent'];
export type TrackCollection = Schemas['TrackCollection'];

export interface Alarm {
  id: string;
  vehicle_id: Maybe<string>;
  severity: Severity;
  code: string;
  text: string;
  active: boolean;
  since_unix_us?: number;
}

export interface Recording {
  active: boolean;
  flight_id: Maybe<string>;
  duration_s?: Maybe<number>;
  bytes?: Maybe<number>;
}

export interface HelloMessage extends Envelope {
  type: 'hello';
  station: { name: string; version: string; data_dir_free_bytes: number };
  vehicles: VehicleSummary[];
  maps: MapSummary[];
  targets: TargetCollection;
  alarms: Alarm[];
  recording: Recording;
  waiting_for: string[];
  /** The name of the pad that is looked for; an older station does not say. */
  pad?: Maybe<string>;
}

export interface StateMessage extends Envelope {
  type: 'state';
  vehicle_id: string;
  /** What the estimate is for, on the time base of the vehicle's video; in a replay the time of the flight. */
  t_state_unix_us?: number;
  epoch: number;
  mode: Mode;
  process_model: Maybe<string>;
  lat_deg: Maybe<number>;
  lon_deg: Maybe<number>;
  alt_amsl_m: Maybe<number>;
  alt_agl_m: Maybe<number>;
  std_n_m: Maybe<number>;
  std_e_m: Maybe<number>;
  std_d_m: Maybe<number>;
  cov_ne_m2: Maybe<number>;
  ellipse95: Maybe<Ellipse95>;
  vn_m_s: Maybe<number>;
  ve_m_s: Maybe<number>;
  vd_m_s: Maybe<number>;
  ground_speed_m_s: Maybe<number>;
  roll_deg: Maybe<number>;
  pitch_deg: Maybe<number>;
  heading_deg: Maybe<number>;
  last_fix_age_s: Maybe<number>;
  gps_denied: boolean;
  footprint: Maybe<[number, number][]>;
  /** What is added to frame times. Null without a camera file, and in replays; an older station does not say. */
  video_clock?: Maybe<VideoClock>;
  /** From the stated mount to the true one, about x, y, z of the body or of the gimbal's frame. */
  boresight_deg?: Maybe<Maybe<number>[]>;
  boresight_std_deg?: Maybe<Maybe<number>[]>;
}

export type VideoClock = Schemas['VideoClockBody'];

export interface GpsMessage extends Envelope {
  type: 'gps';
  vehicle_id: string;
  t_gps_unix_us?: number;
  lat_deg: Maybe<number>;
  lon_deg: Maybe<number>;
  alt_amsl_m: Maybe<number>;
  fix_type: number;
  satellites: Maybe<number>;
  std_horizontal_m: Maybe<number>;
  used: boolean;
}

export interface TelemetryMessage extends Envelope {
  type: 'telemetry';
  vehicle_id: string;
  vehicle_type: Maybe<string>;
  simulated: boolean;
  armed: boolean;
  flight_mode: Maybe<string>;
  battery_pct: Maybe<number>;
  battery_v: Maybe<number>;
  airspeed_m_s: Maybe<number>;
  /** The item of its mission that the vehicle flies to, from 1. */
  mission_item?: Maybe<number>;
  home?: Maybe<{ lat_deg: number; lon_deg: number; alt_amsl_m: number }>;
  // An older station does not say these. Each age is of the value before it.
  battery_a?: Maybe<number>;
  battery_age_s?: Maybe<number>;
  airspeed_age_s?: Maybe<number>;
  /** Above the autopilot's home, by the autopilot. */
  alt_rel_m?: Maybe<number>;
  alt_rel_age_s?: Maybe<number>;
  wind_speed_m_s?: Maybe<number>;
  wind_from_deg?: Maybe<number>;
  wind_age_s?: Maybe<number>;
}

export interface LinkMessage extends Envelope {
  type: 'link';
  vehicle_id: string;
  connected: boolean;
  heartbeat_age_s: Maybe<number>;
  messages_per_s: Maybe<number>;
  bytes_per_s: Maybe<number>;
  loss_pct: Maybe<number>;
  noise_bytes: Maybe<number>;
  signed: Maybe<boolean>;
  endpoint: Maybe<string>;
}

export type VideoStatus = 'waiting' | 'flowing' | 'frozen' | 'stopped';

export interface VideoMessage extends Envelope {
  type: 'video';
  source: string;
  vehicle_id: Maybe<string>;
  status: VideoStatus;
  fps: Maybe<number>;
  width: Maybe<number>;
  height: Maybe<number>;
  codec: Maybe<string>;
  last_frame_age_s: Maybe<number>;
  latency_ms: Maybe<number>;
  decode_errors: Maybe<number>;
  epoch: number;
}

export interface FixMessage extends Envelope {
  type: 'fix';
  vehicle_id: string;
  frame_id: Maybe<number>;
  /** When its picture was taken. */
  t_fix_unix_us?: number;
  kind: string;
  accepted: boolean;
  reason: Maybe<string>;
  lat_deg: Maybe<number>;
  lon_deg: Maybe<number>;
  cov_ne_m2: Maybe<unknown>;
  score: Maybe<number>;
  elapsed_ms: Maybe<number>;
}

export type TargetMessage = Envelope & { type: 'target' } & (
    | { action: 'created' | 'updated'; target: Target }
    | { action: 'deleted'; target: string | { id: string } }
  );

/** What one picture showed of a followed target; place and track as in the target's properties. */
export interface SightingMessage extends Envelope {
  type: 'sighting';
  vehicle_id: string;
  target_id: string;
  frame_id: number;
  t_frame_unix_us: number;
  /** In the video; null where it is not seen. */
  u_px: Maybe<number>;
  v_px: Maybe<number>;
  size_px: Maybe<number>;
  confidence: Maybe<number>;
  lat_deg: number;
  lon_deg: number;
  alt_amsl_m: number;
  ce90_m: number;
  ellipse95: Ellipse95;
  track: TargetTrack;
}

export interface AlarmMessage extends Envelope, Alarm {
  type: 'alarm';
}

export interface AckMessage extends Envelope {
  type: 'ack';
  command_id: string;
  vehicle_id: string;
  command: string;
  status: string;
  text: string;
  /** Of a comparison: whether the vehicle holds the kept plan. */
  same?: boolean;
}

/** The plan that is kept for a vehicle is another now, or gone. */
export interface PlanMessage extends Envelope {
  type: 'plan';
  vehicle_id: string;
  etag: Maybe<string>;
}

export type MapMessage = Envelope & { type: 'map' } & (
    | { action: 'created' | 'updated'; map: MapSummary }
    | { action: 'deleted'; map: string | { id: string } }
  );

export interface RecordingMessage extends Envelope, Recording {
  type: 'recording';
}

export interface ReplayMessage extends Envelope {
  type: 'replay';
  vehicle_id: string;
  flight_id: string;
  /** Where the replay stands; the envelope's `t_unix_us` yields to this on replay messages. */
  start_unix_us: number;
  end_unix_us: number;
  speed: number;
  paused: boolean;
  /** It stands at its end; one can still go back. */
  ended?: boolean;
  /** Of the estimate that is being computed, 0 to 1; null when it is done or not needed. */
  progress?: Maybe<number>;
}

/** While a flight is being read, before its replay appears as a vehicle. */
export interface ReplayPreparingMessage extends Envelope {
  type: 'replay_preparing';
  vehicle_id: string;
  flight_id: string;
  /** 0 to 1. */
  progress: number;
}

export type LandingMessage = Envelope & Landing & { type: 'landing' };

export type HomingMessage = Envelope & Homing & { type: 'homing' };
/** While the autopilot is told where the vehicle is. */
export type AidingMessage = Envelope & Aiding & { type: 'aiding' };

/** Another pad is looked for, or none. */
export interface PadMessage extends Envelope {
  type: 'pad';
  name: Maybe<string>;
}

export interface WaitingMessage extends Envelope {
  type: 'waiting';
  waiting_for: string[];
}

export interface VehicleMessage extends Envelope {
  type: 'vehicle';
  action: 'created' | 'updated' | 'deleted';
  vehicle: VehicleSummary | string;
}

export interface PongMessage extends Envelope {
  type: 'pong';
}

export type StationMessage =
  | HelloMessage
  | StateMessage
  | GpsMessage
  | TelemetryMessage
  | LinkMessage
  | VideoMessage
  | FixMessage
  | TargetMessage
  | SightingMessage
  | AlarmMessage
  | AckMessage
  | MapMessage
  | RecordingMessage
  | ReplayMessage
  | ReplayPreparingMessage
  | LandingMessage
  | HomingMessage
  | AidingMessage
  | PadMessage
  | PlanMessage
  | WaitingMessage
  | VehicleMessage
  | PongMessage;

/** In front of every encoded picture on the video socket. */
export interface FrameHeader {
  frame_id: number;
  epoch: number;
  t_unix_us: number;
  t_wire_unix_us: number;
  codec: 'h264' | 'jpeg';
  codec_string: string;
  key: boolean;
  width: number;
  height: number;
  latency_ms: Maybe<number>;
}

/** RFC 9457. */
export interface Problem {
  type?: string;
  title?: string;
  status?: number;
  detail?: string;
  errors?: unknown;
}
