/** The plan of the selected vehicle while it is made: what is drawn, what is kept, and what is done with the vehicle. */

import { ApiError } from '../api/client';
import type { PlanApi, PlanPart } from '../api/plans';
import type { PlanPath, StationMessage } from '../api/types';
import type { LatLon } from '../geo/earth';
import { insertedAt, moved, removed, sameHandle, type Edge, type Handle } from '../store/handles';
import { addCircle, addPoint, addPolygon, addRally, emptyPlan, PlanEditError, setHome, type PlanDocument } from '../store/plan';
import { noted, NO_HISTORY, redone, undone, type History } from '../store/undo';
import type { Fly } from './fly.svelte';

const SAVE_AFTER_MS = 400;
const CIRCLE_M = 80;

/** What a click on the map makes; 'none' only shows. */
export type Tool = 'none' | 'points' | 'polygon' | 'circle' | 'rally' | 'home';
export type SaveState = 'none' | 'loading' | 'saved' | 'unsaved' | 'saving' | 'conflict' | 'failed';

export class Planner {
  vehicle_id = $state<string | null>(null);
  document = $state.raw<PlanDocument | null>(null);
  path = $state.raw<PlanPath | null>(null);
  state = $state<SaveState>('none');
  /** Why it could not be kept, fetched or edited. */
  trouble = $state('');
  tool = $state<Tool>('none');
  /** Whether what is drawn next is to stay inside of. */
  inclusion = $state(true);
  /** Corners of a polygon that is not closed yet. */
  draft = $state.raw<LatLon[]>([]);
  selected = $state.raw<Handle | null>(null);
  /** Of the next point, metres above home. */
  alt_m = $state<number | null>(50);
  /** Of the last operation with the vehicle. */
  operation = $state<string | null>(null);
  history = $state.raw<History<PlanDocument | null>>(NO_HISTORY);
  private etag: string | null = null;
  private timer: ReturnType<typeof setTimeout> | null = null;
  private saving: Promise<void> | null = null;
  /** Goes up with every vehicle, so that late answers are known. */
  private turn = 0;

  constructor(
    private readonly api: PlanApi,
    private readonly fly: Fly,
  ) {}

  /** The plan of another vehicle; replays have none. */
  open(vehicle_id: string | null): void {
    this.flush();
    this.turn += 1;
    this.vehicle_id = vehicle_id !== null && /^\d+$/.test(vehicle_id) ? vehicle_id : null;
    [this.document, this.path, this.etag, this.selected, this.operation] = [null, null, null, null, null];
    [this.history, this.draft, this.tool, this.trouble, this.state] = [NO_HISTORY, [], 'none', '', 'none'];
    if (this.vehicle_id !== null) void this.load();
  }

  take(message: StationMessage): void {
    if (message.type === 'hello' && this.vehicle_id !== null && this.state !== 'unsaved' && this.state !== 'saving') void this.load();
    if (message.type !== 'plan' || message.vehicle_id !== this.vehicle_id || message.etag === this.etag) return;
    // One's own save may be told before it is answered.
    if (this.state === 'saving' || this.saving) return;
    if (this.state === 'unsaved') this.conflict();
    else void this.load();
  }

  /** What the station keeps; what is here can be gone back to. */
  async load(): Promise<void> {
    const { vehicle_id, turn } = this;
    if (vehicle_id === null) return;
    try {
      const path = await this.api.path(vehicle_id);
      const etag = path.properties.etag;
      const kept = etag === null || etag === this.etag ? null : await this.api.fetch(vehicle_id);
      if (turn !== this.turn || this.state === 'unsaved' || this.state === 'saving') return;
      this.path = path;
      if (etag !== this.etag) {
        if (this.document) this.history = noted(this.history, this.document);
        this.document = kept?.document ?? null;
        this.etag = kept?.etag ?? null;
        this.selected = null;
      }
      this.state = this.document ? 'saved' : 'none';
      this.trouble = '';
    } catch (error) {
      if (turn === this.turn) this.fail(error);
    }
  }

  edit(change: (plan: PlanDocument) => PlanDocument, home: (LatLon & { alt_amsl_m: number }) | null = null): boolean {
    if (this.vehicle_id === null) return false;
    try {
      const before = this.document;
      const after = change(before ?? emptyPlan(home, home?.alt_amsl_m));
      if (after === before) return false;
      this.history = noted(this.history, before);
      this.put(after);
      return true;
    } catch (error) {
      if (!(error instanceof PlanEditError)) throw error;
      this.trouble = error.message;
      return false;
    }
  }

  step(which: 'undo' | 'redo'): void {
    if (which === 'undo' && this.draft.length > 0) {
      this.draft = this.draft.slice(0, -1);
      return;
    }
    const back = (which === 'undo' ? undone : redone)(this.history, this.document);
    if (!back) return;
    this.history = back.history;
    this.selected = null;
    // A plan that is gone is one without items: the station keeps what was there only so long as it is not put again.
    this.put(back.now ?? emptyPlan(null));
  }

  /** What a click on the map means now. */
  click(at: LatLon, home: (LatLon & { alt_amsl_m: number }) | null): void {
    const alt_m = this.alt_m ?? 50;
    switch (this.tool) {
      case 'points':
        this.edit((plan) => addPoint(plan, at, alt_m), home);
        break;
      case 'polygon':
        this.draft = [...this.draft, at];
        break;
      case 'circle':
        this.edit((plan) => addCircle(plan, this.inclusion, at, CIRCLE_M), home);
        break;
      case 'rally':
        this.edit((plan) => addRally(plan, at, alt_m), home);
        break;
      case 'home':
        if (this.edit((plan) => setHome(plan, at), home)) this.tool = 'none';
        break;
      case 'none':
        this.selected = null;
    }
  }

  closePolygon(home: (LatLon & { alt_amsl_m: number }) | null): void {
    if (this.draft.length < 3) return;
    const ring = this.draft;
    this.draft = [];
    this.edit((plan) => addPolygon(plan, this.inclusion, ring), home);
  }

  drop(handle: Handle, at: LatLon): void {
    this.edit((plan) => moved(plan, handle, at));
  }

  insert(edge: Edge, at: LatLon): void {
    this.edit((plan) => {
      const made = insertedAt(plan, edge, at);
      this.selected = made.handle;
      return made.plan;
    });
  }

  remove(handle: Handle): void {
    if (this.edit((plan) => removed(plan, handle))) this.selected = null;
  }

  toggle(handle: Handle): void {
    this.selected = sameHandle(this.selected, handle) ? null : handle;
  }

  use(tool: Tool): void {
    this.tool = this.tool === tool ? 'none' : tool;
    this.draft = [];
  }

  /** A .plan or waypoint file in place of what is kept. */
  async importFile(content: string, name: string): Promise<void> {
    const { vehicle_id } = this;
    if (vehicle_id === null) return;
    await this.settle();
    this.state = 'saving';
    try {
      await this.api.keep(vehicle_id, content, { etag: this.etag });
      this.state = 'saved';
      await this.load();
    } catch (error) {
      if (error instanceof ApiError && error.status === 412) this.conflict();
      else {
        this.state = this.document ? 'saved' : 'none';
        this.trouble = `${name}: ${error instanceof Error ? error.message : String(error)}`;
      }
    }
  }

  /** Of two pages that have changed the plan one gives way. */
  async resolve(keep: 'mine' | 'theirs'): Promise<void> {
    if (keep === 'theirs') {
      this.state = 'saved';
      await this.load();
      return;
    }
    await this.save('any');
  }

  async upload(parts: PlanPart[] | null): Promise<void> {
    await this.operate('Send the plan', (id) => this.api.upload(id, parts));
  }

  async download(): Promise<void> {
    await this.operate('Fetch the plan', (id) => this.api.download(id));
  }

  async compare(): Promise<void> {
    await this.operate('Compare the plan', (id) => this.api.compare(id));
  }

  fileUrl(): string {
    return this.vehicle_id === null ? '' : this.api.fileUrl(this.vehicle_id);
  }

  /** Keep at once what waits. */
  flush(urgently = false): void {
    if (this.timer !== null) void this.save({ etag: this.etag }, urgently);
  }

  private async operate(words: string, begin: (vehicle_id: string) => Promise<string>): Promise<void> {
    const { vehicle_id } = this;
    if (vehicle_id === null) return;
    await this.settle();
    if (this.state === 'conflict' || this.state === 'failed') return;
    this.operation = await this.fly.ask(vehicle_id, words, () => begin(vehicle_id));
    if (this.operation === null) this.operation = 'refused';
  }

  /** Until nothing waits to be kept. */
  async settle(): Promise<void> {
    this.flush();
    while (this.saving) await this.saving;
  }

  private put(document: PlanDocument): void {
    this.document = document;
    this.trouble = '';
    if (this.state === 'conflict') return;
    this.state = 'unsaved';
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = setTimeout(() => void this.save({ etag: this.etag }), SAVE_AFTER_MS);
  }

  private async save(base: { etag: string | null } | 'any', urgently = false): Promise<void> {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = null;
    while (this.saving) {
      await this.saving;
      // Its answer has brought a new ETag.
      if (base !== 'any') base = { etag: this.etag };
    }
    this.saving = this.send(base, urgently);
    await this.saving;
  }

  private async send(base: { etag: string | null } | 'any', urgently: boolean): Promise<void> {
    const { vehicle_id, document, turn } = this;
    if (vehicle_id === null || document === null) return void (this.saving = null);
    this.state = 'saving';
    try {
      const etag = await this.api.keep(vehicle_id, JSON.stringify(document), base, urgently);
      if (turn !== this.turn) return;
      this.etag = etag;
      if (this.document === document) this.state = 'saved';
      const path = await this.api.path(vehicle_id);
      if (turn === this.turn && this.etag === path.properties.etag) this.path = path;
    } catch (error) {
      if (turn !== this.turn) return;
      if (error instanceof ApiError && error.status === 412) this.conflict();
      else this.fail(error);
    } finally {
      this.saving = null;
    }
  }

  private conflict(): void {
    if (this.timer !== null) clearTimeout(this.timer);
    this.timer = null;
    this.state = 'conflict';
    this.trouble = '';
  }

  private fail(error: unknown): void {
    this.state = 'failed';
    this.trouble = error instanceof Error ? error.message : String(error);
  }
}
