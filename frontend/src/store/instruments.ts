/** What the instruments read, in the operator's units: a value, or a dash; and whether it is too old to be believed. Pure. */

import type { GpsMessage, StateMessage, TelemetryMessage, VideoMessage } from '../api/types';
import { DASH, formatAge, formatHeading, formatNumber, type Quantity } from '../geo/format';
import { climbShown, formatAxes, formatLength, inUnit, lengthShown, numberIn, speedShown, type Units } from '../geo/units';
import { isReplay, type Vehicle } from './mission';
import { fixAgeTone, linkWords, videoWords, type Tone } from './words';

export interface Reading {
  id: string;
  label: string;
  /** Said when the pointer rests on it. */
  title: string;
  value: string;
  unit: string;
  /** A second, smaller line. */
  below: string;
  tone: Tone;
  /** Too old to be believed; `below` then says how old. */
  stale: boolean;
}

/** Seconds since each kind of message came to this page; null where none has. */
export interface Heard {
  state: number | null;
  gps: number | null;
  telemetry: number | null;
  link: number | null;
  video: number | null;
}

/** How long a picture spends where, medians in milliseconds. */
export interface PictureTimes {
  received_ms: number | null;
  decoded_ms: number | null;
  drawn_ms: number | null;
}

/** After so long without news, by what it is news of. */
export const STALE_S = { state: 2, gps: 3, telemetry: 3, link: 4, video: 4, battery: 10, wind: 15 } as const;
const LOW_BATTERY_PCT = 20;
const BATTERY_WATCH_PCT = 35;

type Part = Omit<Reading, 'stale'>;

/** Marks a reading as old. What is unknown is a dash, and a dash has no age. */
function aged(part: Part, age_s: Quantity, most_s: number): Reading {
  const stale = part.value !== DASH && typeof age_s === 'number' && age_s > most_s;
  return stale ? { ...part, below: `${formatAge(age_s)} old`, tone: 'none', stale } : { ...part, stale };
}

/** The age that the station told, and how long ago it told it. */
function since(told_s: Quantity, heard_s: Quantity): number | null {
  return typeof told_s === 'number' && typeof heard_s === 'number' ? told_s + heard_s : null;
}

function motion(state: StateMessage | null, telemetry: TelemetryMessage | null, heard: Heard, units: Units): Reading[] {
  const length = lengthShown(units);
  const speed = speedShown(units, units.speed === 'm_s' ? 1 : 0);
  const climb = climbShown(units);
  const up_m_s = state?.vd_m_s === null || state?.vd_m_s === undefined ? null : -state.vd_m_s;
  const estimate = (part: Omit<Part, 'tone'>) => aged({ ...part, tone: 'none' }, heard.state, STALE_S.state);
  const heading = inUnit(state?.heading_deg, { factor: 1, digits: 0, name: '°' });
  const airAge = since(telemetry?.airspeed_age_s, heard.telemetry);
  const homeAge = since(telemetry?.alt_rel_age_s, heard.telemetry);
  return [
    estimate({ id: 'heading', label: 'Heading', title: 'By the estimate, from true north', value: heading === null ? DASH : formatHeading(heading), unit: '°', below: '' }),
    aged({ id: 'airspeed', label: 'Air speed', title: "The autopilot's air speed; without a sensor it may be made up from GPS", value: numberIn(telemetry?.airspeed_m_s, speed), unit: speed.name, below: '', tone: 'none' }, airAge, STALE_S.telemetry),
    estimate({ id: 'ground-speed', label: 'Ground speed', title: 'By the estimate', value: numberIn(state?.ground_speed_m_s, speed), unit: speed.name, below: '' }),
    estimate({ id: 'agl', label: 'Above ground', title: 'Height above the terrain below, by the estimate', value: numberIn(state?.alt_agl_m, length), unit: length.name, below: '' }),
    aged({ id: 'above-home', label: 'Above home', title: "The autopilot's own height above its home", value: numberIn(telemetry?.alt_rel_m, length), unit: length.name, below: '', tone: 'none' }, homeAge, STALE_S.telemetry),
    estimate({ id: 'amsl', label: 'AMSL', title: 'Height above mean sea level, by the estimate', value: numberIn(state?.alt_amsl_m, length), unit: length.name, below: '' }),
    estimate({ id: 'climb', label: `Climb ${climb.name}`, title: 'By the estimate; down is negative', value: numberIn(up_m_s, climb), unit: '', below: '' }),
  ];
}

function windReading(telemetry: TelemetryMessage | null, heard: Heard, units: Units): Reading {
  const speed = speedShown(units, units.speed === 'm_s' ? 1 : 0);
  const value = numberIn(telemetry?.wind_speed_m_s, speed);
  const below = value === DASH ? '' : `from ${formatHeading(telemetry?.wind_from_deg)}°`;
  const part: Part = { id: 'wind', label: 'Wind', title: "The autopilot's own estimate, and where it comes from", value, unit: speed.name, below, tone: 'none' };
  return aged(part, since(telemetry?.wind_age_s, heard.telemetry), STALE_S.wind);
}

function batteryReading(telemetry: TelemetryMessage | null, heard: Heard): Reading {
  const pct = telemetry?.battery_pct ?? null;
  const volts = telemetry?.battery_v ?? null;
  const amperes = telemetry?.battery_a ?? null;
  const more = [pct !== null && volts !== null ? `${formatNumber(volts, 1)} V` : '', amperes !== null ? `${formatNumber(amperes, 0)} A` : ''];
  const tone: Tone = pct === null ? 'none' : pct < LOW_BATTERY_PCT ? 'bad' : pct < BATTERY_WATCH_PCT ? 'watch' : 'good';
  const part: Part = {
    id: 'battery',
    label: 'Battery',
    title: `What is left by the autopilot; below ${LOW_BATTERY_PCT} % it is low`,
    // An autopilot without a battery monitor's capacity knows the voltage alone.
    value: pct !== null ? formatNumber(pct) : formatNumber(volts, 1),
    unit: pct !== null || volts === null ? '%' : 'V',
    below: more.filter(Boolean).join(' '),
    tone,
  };
  return aged(part, since(telemetry?.battery_age_s, heard.telemetry), STALE_S.battery);
}

function linkReading(vehicle: Vehicle | null, heard: Heard): Reading {
  const words = linkWords(vehicle);
  const link = vehicle?.link ?? null;
  const part = { id: 'link', label: 'Link', title: words.detail, unit: '', tone: words.tone };
  if (vehicle && isReplay(vehicle.id)) return { ...part, value: 'Replay', below: 'recorded', stale: false };
  if (!link) return { ...part, value: DASH, below: 'no telemetry', stale: false };
  if (!link.connected) return { ...part, value: 'LOST', below: `${formatAge(link.heartbeat_age_s)} ago`, stale: false };
  const below = `${formatNumber(link.loss_pct, 1)} % lost`;
  const signing = link.signed ? 'signed' : 'not signed';
  const whole: Part = { ...part, label: `Link ${signing}`, value: formatNumber(link.messages_per_s), unit: 'msg/s', below };
  return aged(whole, heard.link, STALE_S.link);
}

const FIX_TYPES = ['no receiver', 'no fix', '2D', '3D', 'DGPS', 'RTK float', 'RTK fixed', 'static', 'PPP'];

function gpsReading(gps: GpsMessage | null, heard: Heard, units: Units): Reading {
  const part = { id: 'gps', label: 'GPS', unit: '' };
  if (!gps) return { ...part, title: 'The receiver has not said anything', value: DASH, below: '', tone: 'none', stale: false };
  const has = gps.fix_type >= 3;
  const type = FIX_TYPES[gps.fix_type] ?? `type ${gps.fix_type}`;
  const accuracy = gps.std_horizontal_m === null ? '' : ` ±${formatLength(gps.std_horizontal_m, units, 1)}`;
  const whole: Part = {
    ...part,
    label: gps.used ? 'GPS in use' : 'GPS not used',
    title: `${type}, ${gps.satellites ?? DASH} satellites${accuracy}; ${gps.used ? 'used by' : 'kept from'} the estimator`,
    value: has ? formatNumber(gps.satellites) : 'none',
    unit: has ? 'sat' : '',
    below: has ? `${type}${accuracy}` : type,
    tone: !has ? 'bad' : gps.used ? 'good' : 'none',
  };
  return aged(whole, heard.gps, STALE_S.gps);
}

function videoReading(vehicle: Vehicle | null, video: VideoMessage | null, heard: Heard, times: PictureTimes): Reading {
  const words = videoWords(vehicle);
  const ms = (value: Quantity) => formatNumber(value);
  const stages = `${ms(video?.latency_ms)} in · ${ms(times.received_ms)} net · ${ms(times.decoded_ms)} dec · ${ms(times.drawn_ms)} all`;
  const flowing = video?.status === 'flowing';
  const part: Part = {
    id: 'video',
    label: 'Video, ms',
    title: `${words.detail}. Medians in milliseconds: in, from the camera's bytes to the station's picture; net, from the station to this page; dec, decoded here; all, from the station to the screen`,
    value: flowing ? formatNumber(video.fps) : words.text,
    unit: flowing ? 'fps' : '',
    below: flowing ? stages : '',
    tone: words.tone,
  };
  return aged(part, heard.video, STALE_S.video);
}

/** Decimals mean nothing beside hundreds, and there is no room for them. */
function sigmaShown(sigmas_m: readonly Quantity[], units: Units) {
  const shown = lengthShown(units, 1);
  return sigmas_m.some((std_m) => (inUnit(std_m, shown) ?? 0) >= 99.95) ? lengthShown(units) : shown;
}

function estimateReadings(vehicle: Vehicle | null, heard: Heard, units: Units): Reading[] {
  const state = vehicle?.state ?? null;
  const fix_s = state?.last_fix_age_s ?? null;
  const refused = vehicle?.fix && !vehicle.fix.accepted ? `; last refused: ${vehicle.fix.reason}` : '';
  const counts = `${vehicle?.fixesAccepted ?? 0} accepted, ${vehicle?.fixesRejected ?? 0} refused${refused}`;
  const sigmas = [state?.std_n_m, state?.std_e_m, state?.std_d_m];
  const length = sigmaShown(sigmas, units);
  const fix: Part = {
    id: 'fix',
    label: 'Last fix',
    title: `Time since the last accepted vision fix; ${counts}. The estimator flies by ${state?.process_model?.replaceAll('_', ' ') ?? DASH}`,
    value: fix_s === null ? DASH : formatAge(fix_s),
    unit: '',
    below: state ? state.mode.replaceAll('_', ' ') : '',
    tone: fixAgeTone(fix_s),
  };
  const sigma: Part = {
    id: 'sigma',
    label: `σ N E D, ${length.name}`,
    title: 'One standard deviation north, east and down; and the semi-axes of the ellipse that holds the position with 95 % probability',
    value: state ? sigmas.map((std_m) => numberIn(std_m, length)).join(' ') : DASH,
    unit: '',
    below: `95 % ${formatAxes(state?.ellipse95, units, length.digits)}`,
    tone: 'none',
  };
  return [aged(fix, heard.state, STALE_S.state), aged(sigma, heard.state, STALE_S.state)];
}

/** All of them, in the order they are shown. A replay that stands still does not age. */
export function readings(vehicle: Vehicle | null, heard: Heard, times: PictureTimes, units: Units): Reading[] {
  const still = Boolean(vehicle?.replay?.paused || vehicle?.replay?.ended);
  const ages: Heard = still ? { state: 0, gps: 0, telemetry: 0, link: 0, video: 0 } : heard;
  const telemetry = vehicle?.telemetry ?? null;
  return [
    ...motion(vehicle?.state ?? null, telemetry, ages, units),
    windReading(telemetry, ages, units),
    batteryReading(telemetry, ages),
    linkReading(vehicle, ages),
    gpsReading(vehicle?.gps ?? null, ages, units),
    videoReading(vehicle, vehicle?.video ?? null, ages, times),
    ...estimateReadings(vehicle, ages, units),
  ];
}
