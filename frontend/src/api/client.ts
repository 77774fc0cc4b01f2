/** The station's REST interface, as far as the page uses it. Every refusal becomes an `ApiError` in plain words. */

import createClient, { type Client } from 'openapi-fetch';
import type { paths } from './schema';
import { RestPlans, type PlanApi } from './plans';
import type { AidingCheck, AidingForm, Command, Flight, Footprint, History, Homing, HomingRequest, HomingWish, LocatedPixel, MapSummary, Matchability, Pad, Pointing, Problem, Target, TrackCollection } from './types';

/** Whether it is looked for in every picture now. */
export function isFollowed(target: Target): boolean {
  const status = target.properties.track?.status;
  return status === 'seen' || status === 'lost';
}

export class ApiError extends Error {
  constructor(
    readonly status: number | null,
    readonly title: string,
    readonly detail: string,
  ) {
    super(detail ? `${title}: ${detail}` : title);
  }
}

export interface PixelOfFrame {
  frame_id: number;
  u_px: number;
  v_px: number;
}

export interface Alignment {
  frame_id: number;
  north_m: number;
  east_m: number;
  std_m: number;
}

export type NewTarget =
  | ({ vehicle_id: string; name?: string; track?: boolean } & PixelOfFrame & Partial<Pointing>)
  | { lat_deg: number; lon_deg: number; name?: string };

export interface ReplayChange {
  paused?: boolean;
  speed?: number;
  seek_unix_us?: number;
}

/** The pad as from straight above, `side_m` wide, its centre in the middle and its x up. */
export interface PadView {
  frame_id: number;
  side_m: number;
  picture: Blob;
}

export interface LandingWish {
  aiding?: boolean;
  /** Whether a pan-tilt camera is kept on the pad. */
  gaze?: boolean;
  land?: true;
  abort?: true;
}

export interface StationApi {
  readonly plans: PlanApi;
  createTarget(target: NewTarget): Promise<Target>;
  renameTarget(target: Target, name: string): Promise<Target>;
  /** Follow a clicked target from its picture on, or no longer. */
  followTarget(target: Target, track: boolean): Promise<Target>;
  targetTrack(target_id: string): Promise<TrackCollection>;
  /** `urgently` while the page goes away. */
  deleteTarget(target: Target, urgently?: boolean): Promise<void>;
  /** Where a pixel lies; nothing of it is kept. */
  locate(vehicle_id: string, pixel: PixelOfFrame, pointing: Pointing): Promise<LocatedPixel>;
  footprint(vehicle_id: string, frame_id: number, pointing: Pointing): Promise<Footprint>;
  /** How far a frame lies beside its place, as the operator dragged it. */
  align(vehicle_id: string, alignment: Alignment): Promise<void>;
  /** Has a camera that can follow what a pixel shows; null ends that. */
  trackPoint(vehicle_id: string, pixel: PixelOfFrame | null): Promise<void>;
  /** The square of the video about a target's pixel. */
  pictureUrl(target: Target, size_px: number): string;
  exportUrl(format: string): string;
  denyGps(vehicle_id: string, gps_denied: boolean): Promise<void>;
  /** Takes seconds: the vehicle is asked for its parameters. */
  checkAiding(vehicle_id: string, form: AidingForm | null): Promise<AidingCheck>;
  /** What is begun here ends with this page. */
  aid(vehicle_id: string, aiding: AidingForm | 'off'): Promise<void>;
  injectGpsFailure(vehicle_id: string, failure: 'off' | 'ok'): Promise<string>;
  /** The id under which its acknowledgements come on the stream. */
  command(vehicle_id: string, command: Command): Promise<string>;
  track(vehicle_id: string, source: 'gps' | 'vision'): Promise<TrackCollection>;
  /** The last hour of a vehicle after a time, thinned to one state in `step_us`; all of a replayed flight. */
  history(vehicle_id: string, since_us: number, step_us: number): Promise<History>;
  flights(): Promise<Flight[]>;
  /** One page about a flight. */
  reportUrl(flight_id: string): string;
  deleteFlight(flight_id: string): Promise<void>;
  record(active: boolean, name?: string): Promise<void>;
  startReplay(flight_id: string, speed: number): Promise<string>;
  changeReplay(vehicle_id: string, change: ReplayChange): Promise<void>;
  leaveReplay(vehicle_id: string): Promise<void>;
  importMap(file: File, progress: (fraction: number) => void): Promise<MapSummary>;
  deleteMap(map_id: string): Promise<void>;
  tileUrl(map_id: string): string;
  /** The layer that a map has, computed first where it has none: seconds for each square kilometre. */
  matchability(map_id: string): Promise<Matchability>;
  matchabilityTileUrl(map_id: string): string;
  /** Null where none is described. */
  pad(): Promise<Pad | null>;
  givePad(description: unknown): Promise<Pad>;
  removePad(): Promise<void>;
  /** What is begun here ends with this page. */
  askLanding(vehicle_id: string, wish: LandingWish): Promise<void>;
  /** The way home, flown or only shown; what is flown ends with this page. */
  askHoming(vehicle_id: string, wish: HomingWish): Promise<Homing>;
  /** Null where no picture has shown the pad lately. */
  padView(vehicle_id: string): Promise<PadView | null>;
}

/** What a refusal says. Anything that is no problem document still gives a sentence. */
export function problemError(status: number, body: string): ApiError {
  let problem: Problem = {};
  try {
    const parsed: unknown = JSON.parse(body);
    if (typeof parsed === 'object' && parsed !== null) problem = parsed as Problem;
  } catch {
    // Not JSON: a proxy's page, or nothing at all.
  }
  const detail = typeof problem.detail === 'string' ? problem.detail : listed(problem.errors ?? problem.detail);
  return new ApiError(status, problem.title ?? `The station refused (${status})`, detail);
}

function listed(errors: unknown): string {
  if (!Array.isArray(errors)) return '';
  return errors
    .map((error: { msg?: string; message?: string; loc?: unknown[] }) =>
      [error.loc?.join('.'), error.msg ?? error.message].filter(Boolean).join(': '),
    )
    .join('; ');
}

const UNREACHABLE = 'The station does not answer';

interface Answer<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

export class RestApi implements StationApi {
  private readonly client: Client<paths>;
  readonly plans: PlanApi;

  constructor(
    private readonly base: string,
    private readonly send: (request: Request) => Promise<Response> = (request) => fetch(request),
    /** Under which the station knows this page. */
    private readonly page = '',
  ) {
    this.client = createClient<paths>({ baseUrl: base.replace(/\/$/, ''), fetch: send });
    this.plans = new RestPlans(base, send);
  }

  private async answer<T>(request: Promise<Answer<T>>): Promise<T> {
    let answer: Answer<T>;
    try {
      answer = await request;
    } catch (error) {
      throw new ApiError(null, UNREACHABLE, error instanceof Error ? error.message : String(error));
    }
    const { data, error, response } = answer;
    if (!response.ok) throw problemError(response.status, typeof error === 'string' ? error : JSON.stringify(error ?? {}));
    return data as T;
  }

  createTarget(target: NewTarget): Promise<Target> {
    return this.answer(this.client.POST('/api/v1/targets', { body: target }));
  }

  renameTarget(target: Target, name: string): Promise<Target> {
    const params = { path: { target_id: target.id }, header: ifMatch(target) };
    return this.answer(this.client.PATCH('/api/v1/targets/{target_id}', { params, body: { name } }));
  }

  followTarget(target: Target, track: boolean): Promise<Target> {
    const params = { path: { target_id: target.id } };
    return this.answer(this.client.PATCH('/api/v1/targets/{target_id}', { params, body: { track } }));
  }

  targetTrack(target_id: string): Promise<TrackCollection> {
    return this.answer(this.client.GET('/api/v1/targets/{target_id}/track', { params: { path: { target_id } } }));
  }

  async deleteTarget(target: Target, urgently = false): Promise<void> {
    const params = { path: { target_id: target.id }, header: ifMatch(target) };
    await this.answer(this.client.DELETE('/api/v1/targets/{target_id}', { params, keepalive: urgently }));
  }

  locate(vehicle_id: string, pixel: PixelOfFrame, pointing: Pointing): Promise<LocatedPixel> {
    const body = { ...pixel, ...pointing };
    return this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/locate', { params: { path: { vehicle_id } }, body }));
  }

  footprint(vehicle_id: string, frame_id: number, pointing: Pointing): Promise<Footprint> {
    const params = { path: { vehicle_id, frame_id }, query: { ...pointing } };
    return this.answer(this.client.GET('/api/v1/vehicles/{vehicle_id}/frames/{frame_id}/footprint', { params }));
  }

  async trackPoint(vehicle_id: string, pixel: PixelOfFrame | null): Promise<void> {
    const body = pixel ? ({ command: 'track_point', ...pixel } as const) : ({ command: 'track_stop' } as const);
    await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/commands', { params: { path: { vehicle_id } }, body }));
  }

  async align(vehicle_id: string, body: Alignment): Promise<void> {
    await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/alignment', { params: { path: { vehicle_id } }, body }));
  }

  pictureUrl(target: Target, size_px: number): string {
    return new URL(`api/v1/targets/${encodeURIComponent(target.id)}/picture?size_px=${size_px}`, this.base).toString();
  }

  exportUrl(format: string): string {
    return new URL(`api/v1/targets?format=${encodeURIComponent(format)}`, this.base).toString();
  }

  async denyGps(vehicle_id: string, gps_denied: boolean): Promise<void> {
    const params = { path: { vehicle_id } };
    await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/navigation', { params, body: { gps_denied } }));
  }

  checkAiding(vehicle_id: string, form: AidingForm | null): Promise<AidingCheck> {
    const params = { path: { vehicle_id }, query: form ? { form } : {} };
    return this.answer(this.client.GET('/api/v1/vehicles/{vehicle_id}/aiding', { params }));
  }

  async aid(vehicle_id: string, aiding: AidingForm | 'off'): Promise<void> {
    const body = this.page ? { aiding, page: this.page } : { aiding };
    await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/navigation', { params: { path: { vehicle_id } }, body }));
  }

  async injectGpsFailure(vehicle_id: string, failure: 'off' | 'ok'): Promise<string> {
    const params = { path: { vehicle_id } };
    const body = { command: 'inject_failure', unit: 'gps', failure } as const;
    return (await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/commands', { params, body }))).command_id;
  }

  async command(vehicle_id: string, body: Command): Promise<string> {
    const params = { path: { vehicle_id } };
    return (await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/commands', { params, body }))).command_id;
  }

  track(vehicle_id: string, source: 'gps' | 'vision'): Promise<TrackCollection> {
    const params = { path: { vehicle_id }, query: { source } };
    return this.answer(this.client.GET('/api/v1/vehicles/{vehicle_id}/tracks', { params }));
  }

  history(vehicle_id: string, since_us: number, step_us: number): Promise<History> {
    const params = { path: { vehicle_id }, query: { since_us, step_us } };
    return this.answer(this.client.GET('/api/v1/vehicles/{vehicle_id}/history', { params }));
  }

  flights(): Promise<Flight[]> {
    return this.answer(this.client.GET('/api/v1/flights'));
  }

  reportUrl(flight_id: string): string {
    return new URL(`api/v1/flights/${encodeURIComponent(flight_id)}/report`, this.base).toString();
  }

  async deleteFlight(flight_id: string): Promise<void> {
    await this.answer(this.client.DELETE('/api/v1/flights/{flight_id}', { params: { path: { flight_id } } }));
  }

  async record(active: boolean, name?: string): Promise<void> {
    const body = name ? { active, name } : { active };
    await this.answer(this.client.POST('/api/v1/recording', { body }));
  }

  async startReplay(flight_id: string, speed: number): Promise<string> {
    const params = { path: { flight_id } };
    const body = { speed, start_s: 0 };
    return (await this.answer(this.client.POST('/api/v1/flights/{flight_id}/replay', { params, body }))).vehicle_id;
  }

  async changeReplay(vehicle_id: string, change: ReplayChange): Promise<void> {
    const params = { path: { vehicle_id } };
    await this.answer(this.client.PATCH('/api/v1/replays/{vehicle_id}', { params, body: change }));
  }

  async leaveReplay(vehicle_id: string): Promise<void> {
    await this.answer(this.client.DELETE('/api/v1/replays/{vehicle_id}', { params: { path: { vehicle_id } } }));
  }

  /** XMLHttpRequest, because fetch does not tell how much of an upload has gone. */
  importMap(file: File, progress: (fraction: number) => void): Promise<MapSummary> {
    return new Promise((resolve, reject) => {
      const request = new XMLHttpRequest();
      const form = new FormData();
      form.append('file', file, file.name);
      request.upload.onprogress = (event) => {
        if (event.lengthComputable) progress(event.loaded / event.total);
      };
      request.onerror = () => reject(new ApiError(null, UNREACHABLE, 'the upload was interrupted'));
      request.onload = () => {
        if (request.status >= 200 && request.status < 300) resolve(JSON.parse(request.responseText) as MapSummary);
        else reject(problemError(request.status, request.responseText));
      };
      request.open('POST', new URL('api/v1/maps', this.base).toString());
      request.send(form);
    });
  }

  async deleteMap(map_id: string): Promise<void> {
    await this.answer(this.client.DELETE('/api/v1/maps/{map_id}', { params: { path: { map_id } } }));
  }

  tileUrl(map_id: string): string {
    return new URL(`api/v1/maps/${encodeURIComponent(map_id)}/tiles/`, this.base).toString() + '{z}/{x}/{y}.png';
  }

  async matchability(map_id: string): Promise<Matchability> {
    const params = { path: { map_id } };
    try {
      return await this.answer(this.client.GET('/api/v1/maps/{map_id}/matchability', { params }));
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 404) throw error;
    }
    return this.answer(this.client.POST('/api/v1/maps/{map_id}/matchability', { params }));
  }

  matchabilityTileUrl(map_id: string): string {
    return new URL(`api/v1/maps/${encodeURIComponent(map_id)}/matchability/`, this.base).toString() + '{z}/{x}/{y}.png';
  }

  pad(): Promise<Pad | null> {
    return orNull(this.answer(this.client.GET('/api/v1/pad')));
  }

  givePad(description: unknown): Promise<Pad> {
    return this.answer(this.client.PUT('/api/v1/pad', { body: description as Record<string, unknown> }));
  }

  async removePad(): Promise<void> {
    await this.answer(this.client.DELETE('/api/v1/pad'));
  }

  async askLanding(vehicle_id: string, wish: LandingWish): Promise<void> {
    const body = this.page ? { ...wish, page: this.page } : wish;
    await this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/landing', { params: { path: { vehicle_id } }, body }));
  }

  askHoming(vehicle_id: string, wish: HomingWish): Promise<Homing> {
    const body = { ...wish, page: this.page || null } as HomingRequest;
    return this.answer(this.client.POST('/api/v1/vehicles/{vehicle_id}/homing', { params: { path: { vehicle_id } }, body }));
  }

  async padView(vehicle_id: string): Promise<PadView | null> {
    const url = new URL(`api/v1/vehicles/${encodeURIComponent(vehicle_id)}/landing/view`, this.base);
    const response = await this.send(new Request(url));
    if (response.status === 204) return null;
    if (!response.ok) throw problemError(response.status, await response.text());
    const of = (name: string) => Number(response.headers.get(name));
    return { frame_id: of('X-Frame-Id'), side_m: of('X-Side-M'), picture: await response.blob() };
  }
}

/** What is not there is an answer too. */
async function orNull<T>(answer: Promise<T>): Promise<T | null> {
  try {
    return await answer;
  } catch (error) {
    if (error instanceof ApiError && error.status === 404) return null;
    throw error;
  }
}

/** A change based on an old version must not overwrite a newer one; that of a followed target rises by itself. */
function ifMatch(target: Target): Record<string, string> {
  if (isFollowed(target)) return {};
  return { 'if-match': `"${target.properties.version}"` };
}
