/** The station's REST interface, as far as the page uses it. Every refusal becomes an `ApiError` in plain words. */

import type { Flight, MapSummary, Problem, Target, TrackCollection } from './types';

export class ApiError extends Error {
  constructor(
    readonly status: number | null,
    readonly title: string,
    readonly detail: string,
  ) {
    super(detail ? `${title}: ${detail}` : title);
  }
}

export type NewTarget =
  | { vehicle_id: string; frame_id: number; u_px: number; v_px: number; name?: string }
  | { lat_deg: number; lon_deg: number; name?: string };

export interface ReplayChange {
  paused?: boolean;
  speed?: number;
  seek_unix_us?: number;
}

export interface StationApi {
  createTarget(target: NewTarget): Promise<Target>;
  renameTarget(target: Target, name: string): Promise<Target>;
  deleteTarget(target: Target): Promise<void>;
  denyGps(vehicle_id: string, gps_denied: boolean): Promise<void>;
  injectGpsFailure(vehicle_id: string, failure: 'off' | 'ok'): Promise<string>;
  track(vehicle_id: string, source: 'gps' | 'vision'): Promise<TrackCollection>;
  flights(): Promise<Flight[]>;
  deleteFlight(flight_id: string): Promise<void>;
  record(active: boolean, name?: string): Promise<void>;
  startReplay(flight_id: string, speed: number): Promise<string>;
  changeReplay(vehicle_id: string, change: ReplayChange): Promise<void>;
  leaveReplay(vehicle_id: string): Promise<void>;
  importMap(file: File, progress: (fraction: number) => void): Promise<MapSummary>;
  deleteMap(map_id: string): Promise<void>;
  tileUrl(map_id: string): string;
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

export class RestApi implements StationApi {
  constructor(
    private readonly base: string,
    private readonly send: typeof fetch = (input, init) => fetch(input, init),
  ) {}

  private async call<T>(method: string, path: string, body?: unknown, headers: Record<string, string> = {}): Promise<T> {
    const init: RequestInit = { method, headers: { ...headers } };
    if (body !== undefined) {
      init.body = JSON.stringify(body);
      init.headers = { ...headers, 'content-type': 'application/json' };
    }
    let response: Response;
    try {
      response = await this.send(new URL(`api/v1/${path}`, this.base).toString(), init);
    } catch (error) {
      throw new ApiError(null, UNREACHABLE, error instanceof Error ? error.message : String(error));
    }
    const text = await response.text();
    if (!response.ok) throw problemError(response.status, text);
    return (text === '' ? undefined : JSON.parse(text)) as T;
  }

  createTarget(target: NewTarget): Promise<Target> {
    return this.call('POST', 'targets', target);
  }

  renameTarget(target: Target, name: string): Promise<Target> {
    return this.call('PATCH', `targets/${encodeURIComponent(target.id)}`, { name }, ifMatch(target));
  }

  async deleteTarget(target: Target): Promise<void> {
    await this.call('DELETE', `targets/${encodeURIComponent(target.id)}`, undefined, ifMatch(target));
  }

  async denyGps(vehicle_id: string, gps_denied: boolean): Promise<void> {
    await this.call('POST', `vehicles/${encodeURIComponent(vehicle_id)}/navigation`, { gps_denied });
  }

  async injectGpsFailure(vehicle_id: string, failure: 'off' | 'ok'): Promise<string> {
    const command = { command: 'inject_failure', unit: 'gps', failure };
    const path = `vehicles/${encodeURIComponent(vehicle_id)}/commands`;
    return (await this.call<{ command_id: string }>('POST', path, command)).command_id;
  }

  track(vehicle_id: string, source: 'gps' | 'vision'): Promise<TrackCollection> {
    return this.call('GET', `vehicles/${encodeURIComponent(vehicle_id)}/tracks?source=${source}`);
  }

  async flights(): Promise<Flight[]> {
    const answer = await this.call<Flight[] | { flights: Flight[] }>('GET', 'flights');
    return Array.isArray(answer) ? answer : answer.flights;
  }

  async deleteFlight(flight_id: string): Promise<void> {
    await this.call('DELETE', `flights/${encodeURIComponent(flight_id)}`);
  }

  async record(active: boolean, name?: string): Promise<void> {
    await this.call('POST', 'recording', name ? { active, name } : { active });
  }

  async startReplay(flight_id: string, speed: number): Promise<string> {
    const path = `flights/${encodeURIComponent(flight_id)}/replay`;
    const answer = await this.call<{ vehicle_id?: string }>('POST', path, { speed, start_s: 0 });
    return answer.vehicle_id ?? `replay-${flight_id}`;
  }

  async changeReplay(vehicle_id: string, change: ReplayChange): Promise<void> {
    await this.call('PATCH', `replays/${encodeURIComponent(vehicle_id)}`, change);
  }

  async leaveReplay(vehicle_id: string): Promise<void> {
    await this.call('DELETE', `replays/${encodeURIComponent(vehicle_id)}`);
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
    await this.call('DELETE', `maps/${encodeURIComponent(map_id)}`);
  }

  tileUrl(map_id: string): string {
    return new URL(`api/v1/maps/${encodeURIComponent(map_id)}/tiles/`, this.base).toString() + '{z}/{x}/{y}.png';
  }
}

/** A change based on an old version must not overwrite a newer one. */
function ifMatch(target: Target): Record<string, string> {
  return { 'if-match': `"${target.properties.version}"` };
}
