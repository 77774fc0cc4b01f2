/** The station's plans over REST. Their refusals are `ApiError`s, as everything else's. */

import type { PlanDocument } from '../store/plan';
import { ApiError, problemError } from './client';
import type { PlanPath } from './types';

/** What a save rests on: the plan with this ETag, no plan at all, or whatever is there. */
export type Base = { etag: string | null } | 'any';
export type PlanPart = 'mission' | 'fence' | 'rally';

export interface KeptPlan {
  document: PlanDocument;
  etag: string;
}

export interface PlanApi {
  /** Null where none is kept. */
  fetch(vehicle_id: string): Promise<KeptPlan | null>;
  /** A document or the content of a file; gives the new ETag. An `ApiError` of 412 where another plan is there by now. */
  keep(vehicle_id: string, content: string, base: Base, urgently?: boolean): Promise<string>;
  /** Its `etag` is null where no plan is kept. */
  path(vehicle_id: string): Promise<PlanPath>;
  /** These give the id of their acknowledgements. */
  upload(vehicle_id: string, parts: PlanPart[] | null): Promise<string>;
  download(vehicle_id: string): Promise<string>;
  compare(vehicle_id: string): Promise<string>;
  fileUrl(vehicle_id: string): string;
}

export class RestPlans implements PlanApi {
  constructor(
    private readonly base: string,
    private readonly send: (request: Request) => Promise<Response>,
  ) {}

  async fetch(vehicle_id: string): Promise<KeptPlan | null> {
    let response: Response;
    try {
      response = await this.ask(`${vehicle_id}/plan?format=plan`);
    } catch (error) {
      if (error instanceof ApiError && error.status === 404) return null;
      throw error;
    }
    return { document: (await response.json()) as PlanDocument, etag: tag(response) };
  }

  async keep(vehicle_id: string, content: string, base: Base, urgently = false): Promise<string> {
    const headers = new Headers({ 'Content-Type': 'application/json' });
    if (base !== 'any') headers.set(base.etag === null ? 'If-None-Match' : 'If-Match', base.etag === null ? '*' : `"${base.etag}"`);
    // A browser keeps only small requests alive; a larger one is sent all the same and mostly arrives.
    const keepalive = urgently && content.length < 60_000;
    return tag(await this.ask(`${vehicle_id}/plan`, { method: 'PUT', headers, body: content, keepalive }));
  }

  async path(vehicle_id: string): Promise<PlanPath> {
    return (await (await this.ask(`${vehicle_id}/plan/path`)).json()) as PlanPath;
  }

  upload(vehicle_id: string, parts: PlanPart[] | null): Promise<string> {
    return this.begin(`${vehicle_id}/plan/upload`, parts ? { parts } : {});
  }

  download(vehicle_id: string): Promise<string> {
    return this.begin(`${vehicle_id}/plan/download`, { replace: true });
  }

  compare(vehicle_id: string): Promise<string> {
    return this.begin(`${vehicle_id}/plan/compare`);
  }

  fileUrl(vehicle_id: string): string {
    return this.url(`${vehicle_id}/plan?format=plan`);
  }

  private async begin(path: string, body?: unknown): Promise<string> {
    const headers = { 'Content-Type': 'application/json' };
    const response = await this.ask(path, { method: 'POST', ...(body ? { headers, body: JSON.stringify(body) } : {}) });
    return ((await response.json()) as { command_id: string }).command_id;
  }

  private url(path: string): string {
    return new URL(`api/v1/vehicles/${path}`, this.base).toString();
  }

  private async ask(path: string, init: RequestInit = {}): Promise<Response> {
    let response: Response;
    try {
      response = await this.send(new Request(this.url(path), init));
    } catch (error) {
      throw new ApiError(null, 'The station does not answer', error instanceof Error ? error.message : String(error));
    }
    if (!response.ok) throw problemError(response.status, await response.text());
    return response;
  }
}

function tag(response: Response): string {
  return (response.headers.get('ETag') ?? '').replace(/^W\//, '').replaceAll('"', '');
}

const refuse = () => Promise.reject(new Error('no plans are kept here'));

/** Of a station that keeps none. */
export const NO_PLANS: PlanApi = {
  fetch: () => Promise.resolve(null),
  keep: refuse,
  path: refuse,
  upload: refuse,
  download: refuse,
  compare: refuse,
  fileUrl: () => '',
};
