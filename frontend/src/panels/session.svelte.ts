/** What the panels share: the folded mission, what is selected, and how the page is set. */

import type { StationApi } from '../api/client';
import { ApiError } from '../api/client';
import type { Matchability, StationMessage, Target } from '../api/types';
import type { CoordinateFormat } from '../geo/format';
import type { ConnectionStatus, Feed, Source } from '../source/source';
import { StateHistory } from '../store/history';
import { isReplay, NO_MISSION, reduce, withTarget, type Mission, type Vehicle } from '../store/mission';
import { PadOutlines } from '../store/landing';
import { SightingBook } from '../store/sightings';
import { TrackBook } from '../store/tracks';
import { Deletions } from '../store/deletions';
import { BROWSER_TIMERS } from '../video/latest';
import { Aim } from './aim.svelte';
import { Fly } from './fly.svelte';
import { MatchOverlay } from './overlay.svelte';
import { Planner } from './planner.svelte';

export type Tab = 'targets' | 'fly' | 'plan' | 'landing' | 'alarms' | 'flights' | 'maps';

export interface Notice {
  id: number;
  tone: 'info' | 'error';
  text: string;
  action?: { label: string; run: () => void } | undefined;
}

interface Preferences {
  format: CoordinateFormat;
  layers: Record<LayerName, boolean>;
}

export type LayerName = 'imagery' | 'gps' | 'vision' | 'ellipse' | 'footprint' | 'targets';

const DEFAULTS: Preferences = {
  format: 'dd',
  layers: { imagery: true, gps: true, vision: true, ellipse: true, footprint: true, targets: true },
};
const STORED_AS = 'pilotage.preferences';
const NOTICE_MS = { info: 3500, error: 12_000 };
const UNDO_MS = 8000;

function storedPreferences(): Preferences {
  try {
    const stored = JSON.parse(localStorage.getItem(STORED_AS) ?? '{}') as Partial<Preferences>;
    return { ...DEFAULTS, ...stored, layers: { ...DEFAULTS.layers, ...stored.layers } };
  } catch {
    return DEFAULTS;
  }
}

/** Resolves once the page had a chance to draw, and even in a hidden tab, where no frames come. */
function drawn(): Promise<void> {
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, 250);
    requestAnimationFrame(() => {
      clearTimeout(timer);
      resolve();
    });
  });
}

export class Session {
  mission = $state.raw<Mission>(NO_MISSION);
  connection = $state.raw<ConnectionStatus>({ phase: 'connecting', attempt: 0, retry_in_ms: null, reason: '' });
  selectedVehicle = $state<string | null>(null);
  selectedTarget = $state<string | null>(null);
  tab = $state<Tab>('targets');
  follow = $state(true);
  videoLarge = $state(false);
  format = $state<CoordinateFormat>(DEFAULTS.format);
  layers = $state<Record<LayerName, boolean>>({ ...DEFAULTS.layers });
  notices = $state.raw<Notice[]>([]);
  /** Goes up with every change of a track. */
  tracksRevision = $state(0);
  /** Goes up with every sighting. */
  sightingsRevision = $state(0);
  /** Whether what is clicked in the video is followed from then on. */
  followClicks = $state(false);
  /** Where the map should go next; a new object each time. */
  goto = $state.raw<{ lat_deg: number; lon_deg: number } | null>(null);

  /** The map whose matchability is drawn, with what was found of it. */
  matchability = $state.raw<Matchability | null>(null);

  /** The target whose name is being changed. */
  renaming = $state<string | null>(null);
  private hiddenTargets = $state.raw<ReadonlySet<string>>(new Set());
  private readonly deletions = new Deletions(
    UNDO_MS,
    (id, urgently) => void this.deleteNow(id, urgently),
    (hidden) => (this.hiddenTargets = hidden),
    BROWSER_TIMERS,
  );

  readonly tracks = new TrackBook();
  readonly sightings = new SightingBook();
  readonly padOutlines = new PadOutlines();
  /** Ticks, so that ages grow while nothing arrives. */
  now_ms = $state(performance.now());
  private readonly heard_ms = new Map<string, number>();
  private clock: ReturnType<typeof setInterval> | null = null;
  private readonly histories = new Map<string, StateHistory>();
  private readonly primed = new Set<string>();
  private noticeCount = 0;
  private awaited: string | null = null;
  private feed: Feed | null = null;

  vehicle = $derived<Vehicle | null>(
    this.selectedVehicle === null ? null : (this.mission.vehicles[this.selectedVehicle] ?? null),
  );
  vehicles = $derived(Object.values(this.mission.vehicles).sort((a, b) => a.id.localeCompare(b.id, 'en', { numeric: true })));
  targets = $derived(
    Object.values(this.mission.targets).filter(({ id }) => !this.hiddenTargets.has(id)).sort((a, b) => b.properties.created_unix_us - a.properties.created_unix_us),
  );
  activeAlarms = $derived(this.mission.alarms.filter((alarm) => alarm.active));

  readonly aim: Aim;
  readonly overlay: MatchOverlay;
  readonly fly: Fly;
  readonly planner: Planner;

  constructor(
    readonly source: Source,
    readonly api: StationApi,
  ) {
    this.aim = new Aim(api);
    this.overlay = new MatchOverlay(api);
    this.fly = new Fly(api);
    this.planner = new Planner(api.plans, this.fly);
    const stored = storedPreferences();
    this.format = stored.format;
    this.layers = stored.layers;
  }

  open(): void {
    this.clock = setInterval(() => (this.now_ms = performance.now()), 500);
    this.feed = this.source.openMessages({
      status: (status) => {
        this.connection = status;
      },
      messages: async (batch) => {
        this.take(batch);
        await drawn();
      },
    });
  }

  close(): void {
    this.deletions.flush();
    this.feed?.close();
    if (this.clock !== null) clearInterval(this.clock);
  }

  private take(batch: StationMessage[]): void {
    let mission = this.mission;
    let moved = false;
    let sighted = false;
    for (const message of batch) {
      mission = reduce(mission, message);
      const cleared = this.tracks.apply(message);
      // After a seek the station knows the trail up to there.
      if (cleared !== null) this.primed.delete(cleared);
      if (message.type === 'state') {
        this.historyOf(message.vehicle_id).append(message);
        this.heard_ms.set(message.vehicle_id, performance.now());
        moved = true;
      }
      if (message.type === 'gps') moved = true;
      sighted = this.sightings.apply(message) || sighted;
      if (message.type === 'landing') sighted = this.padOutlines.take(message) || sighted;
      if (message.type === 'hello') {
        moved = true;
        // After an interruption the station knows more of the track than this page.
        this.primed.clear();
        for (const target of message.targets.features) if (target.properties.track) this.primeTarget(target.id);
      }
      if (message.type === 'fix' && message.kind === 'operator') {
        this.say(message.accepted ? 'info' : 'error', message.accepted ? 'The estimate follows the alignment' : `Alignment: ${message.reason}`);
      }
      this.fly.take(message);
      this.planner.take(message);
      if (message.type === 'ack' && !['accepted', 'in_progress'].includes(message.status)) {
        this.say('error', `${message.command.replaceAll('_', ' ')}: ${message.text || message.status}`);
      }
    }
    this.mission = mission;
    this.chooseVehicle();
    if (moved) this.tracksRevision += 1;
    if (sighted) this.sightingsRevision += 1;
  }

  private chooseVehicle(): void {
    const ids = Object.keys(this.mission.vehicles);
    if (this.awaited !== null && ids.includes(this.awaited)) {
      const { awaited } = this;
      this.awaited = null;
      this.select(awaited);
      return;
    }
    if (this.selectedVehicle !== null && ids.includes(this.selectedVehicle)) {
      this.prime(this.selectedVehicle);
      return;
    }
    const live = ids.find((id) => !isReplay(id));
    const next = live ?? ids[0] ?? null;
    if (next !== this.selectedVehicle) this.select(next);
  }

  select(vehicle_id: string | null): void {
    this.selectedVehicle = vehicle_id;
    this.follow = true;
    this.aim.clear();
    this.overlay.clear();
    this.fly.clear();
    this.planner.open(vehicle_id);
    if (vehicle_id !== null) this.prime(vehicle_id);
  }

  /** Select a vehicle as soon as the station speaks of it. */
  awaitVehicle(vehicle_id: string): void {
    if (vehicle_id in this.mission.vehicles) this.select(vehicle_id);
    else this.awaited = vehicle_id;
  }

  stopPreparing(flight_id: string): void {
    const { [flight_id]: _gone, ...preparing } = this.mission.preparing;
    this.mission = { ...this.mission, preparing };
  }

  private prime(vehicle_id: string): void {
    const { summary, telemetry, state } = this.mission.vehicles[vehicle_id] ?? {};
    // The video may be there first, and the station knows no vehicle yet.
    if (this.primed.has(vehicle_id) || !(summary ?? telemetry ?? state)) return;
    this.primed.add(vehicle_id);
    for (const source of ['gps', 'vision'] as const) {
      this.api
        .track(vehicle_id, source)
        .then((track) => {
          this.tracks.prime(vehicle_id, source, track);
          this.tracksRevision += 1;
        })
        // Without the station's memory the trail simply starts now.
        .catch(() => undefined);
    }
  }

  private primeTarget(id: string): void {
    this.api
      .targetTrack(id)
      .then((track) => {
        this.sightings.prime(id, track);
        this.sightingsRevision += 1;
      })
      .catch(() => undefined);
  }

  /** Seconds since the vehicle's last estimate arrived here. */
  heard_s(vehicle_id: string): number | null {
    const at = this.heard_ms.get(vehicle_id);
    return at === undefined ? null : Math.max(0, this.now_ms - at) / 1000;
  }

  historyOf(vehicle_id: string): StateHistory {
    let history = this.histories.get(vehicle_id);
    if (!history) {
      history = new StateHistory();
      this.histories.set(vehicle_id, history);
    }
    return history;
  }

  say(tone: Notice['tone'], text: string, action?: Notice['action']): void {
    const notice = { id: ++this.noticeCount, tone, text, action };
    this.notices = [...this.notices.slice(-3), notice];
    setTimeout(() => this.dismiss(notice.id), action ? UNDO_MS : NOTICE_MS[tone]);
  }

  dismiss(id: number): void {
    this.notices = this.notices.filter((notice) => notice.id !== id);
  }

  /** Runs something that may be refused; the refusal is shown. */
  async attempt<T>(what: string, work: () => Promise<T>): Promise<T | null> {
    try {
      return await work();
    } catch (error) {
      const why = error instanceof ApiError || error instanceof Error ? error.message : String(error);
      this.say('error', `${what}: ${why}`);
      return null;
    }
  }

  /** The answer to a request, which may come before the message on the socket. */
  keepTarget(target: Target): void {
    this.mission = { ...this.mission, targets: withTarget(this.mission.targets, target) };
  }

  dropTarget(id: string): void {
    const { [id]: _gone, ...targets } = this.mission.targets;
    this.mission = { ...this.mission, targets };
    if (this.selectedTarget === id) this.selectedTarget = null;
  }

  /** Hides a target, and deletes it when nobody has taken that back for a while. */
  deleteTarget(target: Target): void {
    this.deletions.start(target.id);
    if (this.selectedTarget === target.id) this.selectedTarget = null;
    const undo = () => this.undoDeletion(target.id);
    this.say('info', `Deleted ${target.properties.name}`, { label: 'Undo', run: undo });
  }

  /** The page goes away. */
  leave(): void {
    this.deletions.flush();
    this.planner.flush(true);
  }

  /** Of the last one where none is named. */
  undoDeletion(id?: string): void {
    const back = this.deletions.undo(id);
    const name = back === null ? undefined : this.mission.targets[back]?.properties.name;
    if (name !== undefined) this.say('info', `${name} is back`);
  }

  private async deleteNow(id: string, urgently: boolean): Promise<void> {
    const target = this.mission.targets[id];
    if (!target) return;
    const done = await this.attempt('Delete target', async () => {
      await this.api.deleteTarget(target, urgently);
      return true;
    });
    if (done) this.dropTarget(id);
  }

  async renameTarget(target: Target, name: string): Promise<void> {
    this.renaming = null;
    const trimmed = name.trim();
    if (trimmed === '' || trimmed === target.properties.name) return;
    const changed = await this.attempt('Rename', () => this.api.renameTarget(target, trimmed));
    if (changed) this.keepTarget(changed);
  }

  async followTarget(target: Target, track: boolean): Promise<void> {
    const changed = await this.attempt(track ? 'Follow' : 'Stop following', () => this.api.followTarget(target, track));
    if (changed) this.keepTarget(changed);
  }

  toggleFollowClicks(): void {
    this.followClicks = !this.followClicks;
  }

  pickTarget(id: string, centre: boolean): void {
    this.selectedTarget = id;
    this.tab = 'targets';
    const target = this.mission.targets[id];
    if (centre && target) {
      this.follow = false;
      this.goto = { lat_deg: target.properties.lat_deg, lon_deg: target.properties.lon_deg };
    }
  }

  savePreferences(): void {
    try {
      localStorage.setItem(STORED_AS, JSON.stringify({ format: this.format, layers: this.layers }));
    } catch {
      // A browser without storage forgets, and that is all.
    }
  }
}
