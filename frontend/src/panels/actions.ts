/** Every action of the page by name, for the palette. Landing is not among them: it wants a button that is held. */

import { COORDINATE_FORMATS, formatCoordinate, parseCoordinate, type CoordinateFormat } from '../geo/format';
import { AVIATION, LENGTH_UNITS, METRIC, SPEED_UNITS, type LengthUnit, type SpeedUnit } from '../geo/units';
import { isFollowed } from '../api/client';
import { isReplay } from '../store/mission';
import { LAYOUTS, MOTIONS, THEMES, type LayerName, type Layout, type Motion, type Theme } from '../store/settings';
import { vehicleWords } from '../store/words';
import { TABS, type Session } from './session.svelte';

export interface Action {
  id: string;
  group: string;
  label: string;
  keys?: string;
  /** It is so already, or is switched on. */
  on?: boolean;
  run: () => unknown;
}

const LAYER_NAMES: Record<LayerName, string> = {
  imagery: 'imagery', gps: 'GPS track', vision: 'vision track', ellipse: '95 % ellipse', footprint: 'camera footprint', targets: 'targets',
};
const FILES: [string, string][] = [['geojson', 'GeoJSON'], ['kml', 'KML'], ['gpx', 'GPX'], ['csv', 'CSV'], ['cot', 'Cursor on Target']];

function entries<K extends string>(record: Record<K, string>): [K, string][] {
  return Object.entries(record) as [K, string][];
}

function viewActions(session: Session): Action[] {
  const { preferences } = session;
  const { settings } = preferences;
  return [
    ...TABS.map(({ id, label }, at): Action => ({ id: `tab-${id}`, group: 'List', label, keys: String(at + 1), on: session.tab === id, run: () => session.show(id) })),
    ...entries(LAYOUTS).map(([layout, label]): Action => ({ id: `layout-${layout}`, group: 'Layout', label, on: settings.layout === layout, run: () => preferences.set({ layout: layout as Layout }) })),
    { id: 'swap', group: 'Layout', label: 'Exchange map and video', keys: 'X', run: () => session.swap() },
    { id: 'side', group: 'Layout', label: 'Side panel', keys: 'S', on: settings.sidePanel, run: () => preferences.set({ sidePanel: !settings.sidePanel }) },
    { id: 'instruments', group: 'Layout', label: 'Instruments', on: settings.instruments, run: () => preferences.set({ instruments: !settings.instruments }) },
    { id: 'follow', group: 'Map', label: 'Follow the aircraft', on: session.follow, run: () => (session.follow = !session.follow) },
    { id: 'overlay', group: 'Map', label: 'Lay the video on the map', keys: 'O', on: session.overlay.on, run: () => session.overlay.toggle() },
    ...entries(LAYER_NAMES).map(([layer, label]): Action => ({
      id: `layer-${layer}`, group: 'Map', label: `Show ${label}`, on: settings.layers[layer], run: () => preferences.set({ layers: { ...settings.layers, [layer]: !settings.layers[layer] } }),
    })),
  ];
}

function settingActions(session: Session): Action[] {
  const { preferences } = session;
  const { settings } = preferences;
  const set = preferences.set.bind(preferences);
  return [
    ...entries(THEMES).map(([theme, label]): Action => ({ id: `theme-${theme}`, group: 'Colours', label, on: settings.theme === theme, run: () => set({ theme: theme as Theme }) })),
    { id: 'units-metric', group: 'Units', label: 'Metric', run: () => set(METRIC) },
    { id: 'units-aviation', group: 'Units', label: 'Aviation: feet and knots', run: () => set(AVIATION) },
    ...entries(LENGTH_UNITS).map(([length, label]): Action => ({ id: `length-${length}`, group: 'Heights and distances', label, on: settings.length === length, run: () => set({ length: length as LengthUnit }) })),
    ...entries(SPEED_UNITS).map(([speed, label]): Action => ({ id: `speed-${speed}`, group: 'Speeds', label, on: settings.speed === speed, run: () => set({ speed: speed as SpeedUnit }) })),
    ...entries(COORDINATE_FORMATS).map(([format, label]): Action => ({ id: `format-${format}`, group: 'Coordinates', label, on: settings.format === format, run: () => set({ format: format as CoordinateFormat }) })),
    ...entries(MOTIONS).map(([motion, label]): Action => ({ id: `motion-${motion}`, group: 'Motion', label, on: settings.motion === motion, run: () => set({ motion: motion as Motion }) })),
    { id: 'spoken', group: 'Alarms', label: 'Spoken alarms', on: settings.spokenAlarms, run: () => set({ spokenAlarms: !settings.spokenAlarms }) },
    { id: 'settings', group: 'Page', label: 'Settings', keys: ',', run: () => (session.dialog = 'settings') },
    { id: 'keys', group: 'Page', label: 'Keys', keys: '?', run: () => (session.dialog = 'keys') },
    { id: 'defaults', group: 'Page', label: 'Default settings', run: () => preferences.reset() },
  ];
}

function vehicleActions(session: Session): Action[] {
  const { vehicle } = session;
  const actions: Action[] = session.vehicles.map((one) => ({ id: `vehicle-${one.id}`, group: 'Vehicle', label: vehicleWords(one), on: one.id === vehicle?.id, run: () => session.select(one.id) }));
  if (vehicle && !isReplay(vehicle.id)) {
    const { id, state, landing } = vehicle;
    const denied = state?.gps_denied ?? false;
    actions.push({ id: 'deny-gps', group: 'Estimator', label: 'Deny GPS to the estimator', on: denied, run: () => session.attempt('GPS switch', () => session.api.denyGps(id, !denied)) });
    if (landing?.descent?.active) {
      actions.push({ id: 'abort', group: 'Landing', label: 'ABORT the landing', run: () => session.attempt('Abort', () => session.api.askLanding(id, { abort: true })) });
    }
  }
  const { recording } = session.mission;
  actions.push({ id: 'record', group: 'Flights', label: recording.active ? 'Stop recording' : 'Record', on: recording.active, run: () => session.attempt('Recording', () => session.api.record(!recording.active)) });
  return actions;
}

function alarmActions({ alarms }: Session): Action[] {
  const [first] = alarms.loud;
  if (!first) return [];
  return [
    { id: 'acknowledge', group: 'Alarms', label: `Acknowledge: ${first.text}`, keys: 'A', run: () => alarms.acknowledge(first) },
    { id: 'acknowledge-all', group: 'Alarms', label: 'Acknowledge all', run: () => alarms.acknowledge(...alarms.loud) },
  ];
}

function videoActions(session: Session): Action[] {
  const video = session.video;
  const follow: Action = { id: 'follow-clicks', group: 'Video', label: 'Follow what is clicked', keys: 'F', on: session.followClicks, run: () => session.toggleFollowClicks() };
  if (!video) return [follow];
  return [
    { id: 'pause', group: 'Video', label: 'Pause or play', keys: 'Space', run: video.togglePause },
    { id: 'live', group: 'Video', label: 'Back to live', keys: 'End', run: video.live },
    { id: 'previous', group: 'Video', label: 'Previous frame', keys: '←', run: () => video.step(-1) },
    { id: 'next', group: 'Video', label: 'Next frame', keys: '→', run: () => video.step(1) },
    { id: 'hud', group: 'Video', label: 'Head-up figures', run: video.toggleHud },
    { id: 'crosshair', group: 'Video', label: 'Crosshair', keys: 'C', run: video.crosshair },
    { id: 'camera-stop', group: 'Video', label: 'Camera follows no more', run: video.stopTracking },
    follow,
  ];
}

function targetActions(session: Session): Action[] {
  const actions: Action[] = [];
  const chosen = session.targets.find((target) => target.id === session.selectedTarget);
  if (chosen) {
    const { name, frame_id, vehicle_id } = chosen.properties;
    actions.push({ id: 'target-copy', group: 'Target', label: `Copy the coordinate of ${name}`, run: () => session.copyTarget(chosen) });
    actions.push({
      id: 'target-rename', group: 'Target', label: `Rename ${name}`, keys: 'F2',
      run: () => {
        session.show('targets');
        session.renaming = chosen.id;
      },
    });
    if (frame_id !== null && vehicle_id !== null) {
      const followed = isFollowed(chosen);
      actions.push({ id: 'target-follow', group: 'Target', label: followed ? `Stop following ${name}` : `Follow ${name}`, run: () => session.followTarget(chosen, !followed) });
    }
    actions.push({ id: 'target-delete', group: 'Target', label: `Delete ${name}`, keys: 'Del', run: () => session.deleteTarget(chosen) });
  }
  actions.push({ id: 'undo', group: 'Target', label: 'Take back the last deletion', keys: 'Ctrl Z', run: () => session.undoDeletion() });
  for (const target of session.targets.slice(0, 50)) {
    actions.push({ id: `target-${target.id}`, group: 'Target', label: `Show ${target.properties.name}`, run: () => session.pickTarget(target.id, true) });
  }
  for (const [format, label] of FILES) {
    actions.push({
      id: `download-${format}`, group: 'Download', label: `All targets as ${label}`,
      run: () => {
        const link = document.createElement('a');
        link.href = session.api.exportUrl(format);
        link.download = '';
        link.click();
      },
    });
  }
  return actions;
}

/** What a typed coordinate can be used for. */
export function coordinateActions(session: Session, query: string): Action[] {
  const at = parseCoordinate(query);
  if (!at) return [];
  const words = formatCoordinate(at, session.format);
  return [
    {
      id: 'goto', group: 'Map', label: `Show ${words}`,
      run: () => {
        session.follow = false;
        session.goto = at;
      },
    },
    {
      id: 'target-at', group: 'Target', label: `New target at ${words}`,
      run: async () => {
        const made = await session.attempt('New target', () => session.api.createTarget({ ...at }));
        if (!made) return;
        session.keepTarget(made);
        session.pickTarget(made.id, true);
      },
    },
  ];
}

export function actionsOf(session: Session): Action[] {
  return [
    ...alarmActions(session), ...vehicleActions(session), ...viewActions(session), ...videoActions(session), ...targetActions(session), ...settingActions(session),
  ];
}
