/** What the panels share: the folded mission, what is selected, and how the page is set. */

import type { StationApi } from '../api/client';
import { ApiError } from '../api/client';
import type { Matchability, StationMessage, Target, Way } from '../api/types';
import type { CoordinateFormat } from '../geo/format';
import type { Units } from '../geo/units';
import type { ConnectionStatus, Feed, Source } from '../source/source';
import { StateHistory } from '../store/history';
import { isReplay, NO_MISSION, reduce, videoVehicle, withTarget, type Mission, type Vehicle } from '../store/mission';
import type { Heard, PictureTimes } from '../store/instruments';
import { PadOutlines } from '../store/landing';
import { SightingBook } from '../store/sightings';
import { copyText } from '../store/targetList';
import { TrackBook } from '../store/tracks';
import { EventBook } from '../store/events';
import { SeriesBook } from '../store/series';
import { Deletions } from '../store/deletions';
import { BROWSER_TIMERS } from '../video/latest';
import { Aim } from './aim.svelte';
import { Fly } from './fly.svelte';
import { TimeCursor } from './time.svelte';
import { AlarmDesk, speak } from './alarmDesk.svelte';
import { MatchOverlay } from './overlay.svelte';
import { Preferences } from './preferences.svelte';
import { Planner } from './planner.svelte';

export type Tab = 'targets' | 'fly' | 'plan' | 'landing' | 'alarms' | 'flights' | 'maps';

/** In the order they are shown; the number keys open them. */
export const TABS: readonly { id: Tab; label: string }[] = [
  { id: 'targets', label: 'Targets' },
  { id: 'fly', label: 'Fly' },
  { id: 'plan', label: 'Plan' },
  { id: 'landing', label: 'Landing' },
  { id: 'alarms', label: 'Alarms' },
  { id: 'flights', label: 'Flights' },
  { id: 'maps', label: 'Maps' },
];

/** What the palette may ask of the video. */
export interface VideoControls {
  togglePause: () => void;
  live: () => void;
  step: (frames: number) => void;
  toggleHud: () => void;
  crosshair: () => void;
  stopTracking: () => void;
}

export interface Notice {
  id: number;
  tone: 'info' | 'error';
  text: string;
  action?: { label: string; run: () => void } | undefined;
}

const NOTICE_MS = { info: 3500, error: 12_000 };
const UNDO_MS = 8000;
const REMEMBERED_STEP_US = 500_000;
const UNHEARD: Heard = { state: null, gps: null, telemetry: null, link: null, video: null };

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
  /** What lies over the page. */
  dialog = $state<'settings' | 'palette' | 'keys' | null>(null);
  follow = $state(true);
  notices = $state.raw<Notice[]>([]);
  /** Goes up with every change of a track. */
  tracksRevision = $state(0);
  /** Goes up with every sighting. */
  sightingsRevision = $state(0);
  /** Whether what is clicked in the video is followed from then on. */
  followClicks = $state(false);
  /** The way home that was asked for. */
  way = $state.raw<{ vehicle_id: string; way: Way } | null>(null);
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

  readonly preferences = new Preferences();
  readonly alarms = new AlarmDesk(() => this.preferences.settings.spokenAlarms);
  readonly tracks = new TrackBook();
  readonly sightings = new SightingBook();
  readonly series = new SeriesBook();
  readonly events = new EventBook();
  /** Goes up when the station's memory of a vehicle has come. */
  seriesRevision = $state(0);
  readonly padOutlines = new PadOutlines();
  /** Null until the video's panel is there. */
  video: VideoControls | null = null;
  /** What the player measures of its pictures. */
  pictureTimes = $state.raw<PictureTimes>({ received_ms: null, decoded_ms: null, drawn_ms: null });
  /** Ticks, so that ages grow while nothing arrives. */
  now_ms = $state(performance.now());
  private readonly heard_ms = new Map<string, number>();
  private clock: ReturnType<typeof setInterval> | null = null;
  private readonly histories = new Map<string, StateHistory>();
  private readonly primed = new Set<string>();
  /** Replays whose whole flight is known: a seek changes nothing of it. */
  private readonly flightsKnown = new Set<string>();
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

  /** The vehicle as it was at the time that is looked at. */
  shownVehicle = $derived.by<Vehicle | null>(() => {
    const { vehicle } = this;
    const t_us = this.time.at_us;
    void this.seriesRevision;
    if (!vehicle || t_us === null) return vehicle;
    const series = this.series.of(vehicle.id);
    const state = this.historyOf(vehicle.id).at(t_us) ?? series.stateAt(vehicle.id, t_us);
    return { ...vehicle, state, gps: series.gpsAt(vehicle.id, t_us) };
  });

  readonly time = new TimeCursor(() => this.timeSource(), {
    seek: (id, t_us) => this.api.changeReplay(id, { seek_unix_us: t_us, paused: true }),
    pause: async (id, paused) => {
      const { replay } = this.mission.vehicles[id] ?? {};
      const again = replay?.ended && !paused ? { seek_unix_us: replay.start_unix_us } : {};
      await this.attempt('Replay', () => this.api.changeReplay(id, { paused, ...again }));
    },
  });
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
    const { faults } = this.preferences;
    if (faults.length > 0) this.say('error', `Kept settings: ${faults.join(', ')}. The defaults are used instead.`);
  }

  get units(): Units {
    return this.preferences.units;
  }

  get format(): CoordinateFormat {
    return this.preferences.settings.format;
  }

  open(): void {
    this.clock = setInterval(() => (this.now_ms = performance.now()), 500);
    this.feed = this.source.openMessages({
      status: (status) => {
        const before = this.connection.phase;
        this.connection = status;
        if (status.phase === 'retrying' && before === 'open' && this.preferences.settings.spokenAlarms) speak('warning: station lost', true);
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
      if (message.type in UNHEARD) {
        const of = message.type === 'video' ? videoVehicle(message) : (message as { vehicle_id: string }).vehicle_id;
        this.heard_ms.set(`${message.type}:${of}`, performance.now());
      }
      const cleared = this.tracks.apply(message);
      this.series.apply(message);
      this.events.apply(message);
      // After a seek the station knows the trail up to there.
      if (cleared !== null) this.primed.delete(cleared);
      if (message.type === 'state') {
        this.historyOf(message.vehicle_id).append(message);
        moved = true;
      }
      if (message.type === 'gps') moved = true;
      // Its estimate has just been read or computed.
      if (message.type === 'replay' && message.progress == null && this.primed.has(message.vehicle_id) && !this.flightsKnown.has(message.vehicle_id)) {
        this.flightsKnown.add(message.vehicle_id);
        void this.primeSeries(message.vehicle_id);
      }
      sighted = this.sightings.apply(message) || sighted;
      if (message.type === 'landing') sighted = this.padOutlines.take(message) || sighted;
      if (message.type === 'hello') {
        moved = true;
        // After an interruption the station knows more of the track than this page.
        this.primed.clear();
        this.flightsKnown.clear();
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
    this.alarms.take(mission.alarms);
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
    if (vehicle_id !== this.selectedVehicle) this.time.reset();
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
    if (!this.flightsKnown.has(vehicle_id)) void this.primeSeries(vehicle_id);
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

  /** The hour before this page, or the whole of a replayed flight. */
  async primeSeries(vehicle_id: string): Promise<void> {
    try {
      const history = await this.api.history(vehicle_id, 0, REMEMBERED_STEP_US);
      this.series.prime(vehicle_id, history);
      const estimating = this.mission.vehicles[vehicle_id]?.replay?.progress;
      if (isReplay(vehicle_id) && estimating == null) this.flightsKnown.add(vehicle_id);
      this.events.prime(history.events);
      this.seriesRevision += 1;
    } catch {
      // Without the station's memory the curves simply start now.
    }
  }

  /** How long pictures take from the station's door to the screen, by the station's clock. */
  noteDrawn(drawn_ms: number | null): void {
    const id = this.selectedVehicle;
    if (id === null || drawn_ms === null || isReplay(id) || this.time.past) return;
    const series = this.series.of(id);
    if (series.last_us !== null) series.delay(series.last_us, { drawn_ms });
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
    return this.since_s(`state:${vehicle_id}`);
  }

  heard(vehicle_id: string | null): Heard {
    const of = (kind: keyof Heard) => (vehicle_id === null ? null : this.since_s(`${kind}:${vehicle_id}`));
    return { state: of('state'), gps: of('gps'), telemetry: of('telemetry'), link: of('link'), video: of('video') };
  }

  private since_s(key: string): number | null {
    const at = this.heard_ms.get(key);
    return at === undefined ? null : Math.max(0, this.now_ms - at) / 1000;
  }

  private timeSource() {
    const vehicle_id = this.selectedVehicle;
    // Typed arrays tell nobody that they grow.
    void this.tracksRevision;
    void this.seriesRevision;
    const series = vehicle_id === null ? null : this.series.of(vehicle_id);
    return { vehicle_id, first_us: series?.first_us ?? null, last_us: series?.last_us ?? null, replay: this.vehicle?.replay ?? null };
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

  async copyTarget(target: Target): Promise<void> {
    const text = copyText(target.properties, this.format);
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      // Pages that are neither https nor loopback have no clipboard: select a field and use the old command.
      const field = document.createElement('textarea');
      field.value = text;
      document.body.append(field);
      field.select();
      document.execCommand('copy');
      field.remove();
    }
    this.say('info', `Copied ${text}`);
  }

  async followTarget(target: Target, track: boolean): Promise<void> {
    const changed = await this.attempt(track ? 'Follow' : 'Stop following', () => this.api.followTarget(target, track));
    if (changed) this.keepTarget(changed);
  }

  /** Opens a list, also where the side panel is hidden. */
  show(tab: Tab): void {
    this.tab = tab;
    if (!this.preferences.settings.sidePanel) this.preferences.set({ sidePanel: true });
  }

  /** Exchanges map and video, whatever the layout is. */
  swap(): void {
    const { layout, videoLarge } = this.preferences.settings;
    if (layout === 'map' || layout === 'video') this.preferences.set({ layout: layout === 'map' ? 'video' : 'map' });
    else this.preferences.set({ videoLarge: !videoLarge });
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
}
