import { describe, expect, it } from 'vitest';
import type { Alarm, StationMessage, Target } from '../api/types';
import { activeAlarms, NO_MISSION, reduce, videoSourceOf, withTarget, type Mission } from './mission';

const fold = (messages: object[], from: Mission = NO_MISSION) =>
  messages.reduce<Mission>((mission, message) => reduce(mission, message as StationMessage), from);

const target = (id: string, version = 1) => ({ type: 'Feature', id, properties: { version } }) as unknown as Target;
const alarm = (id: string, active = true): Alarm => ({
  id,
  vehicle_id: '1',
  severity: 'warning',
  code: 'gps_lost',
  text: 'GPS lost',
  active,
});
const hello = (fields: object = {}) => ({
  type: 'hello',
  t_unix_us: 5,
  station: { name: 'p', version: '0', data_dir_free_bytes: 1 },
  vehicles: [],
  maps: [],
  targets: { type: 'FeatureCollection', features: [] },
  alarms: [],
  recording: { active: false, flight_id: null },
  waiting_for: [],
  ...fields,
});

describe('reduce', () => {
  it('keeps the newest word on the landing, and asks again for the pad when it may be another', () => {
    const mission = fold([
      hello({ vehicles: [{ id: '1' }] }),
      { type: 'landing', vehicle_id: '1', mode: 'searching' },
      { type: 'landing', vehicle_id: '1', mode: 'tracking' },
    ]);
    expect(mission.vehicles['1']?.landing?.mode).toBe('tracking');
    const after = fold([{ type: 'pad', name: 'other' }], mission);
    expect(after.padRevision).toBe(mission.padRevision + 1);
    expect([mission.padName, after.padName]).toEqual([undefined, 'other']);
    // The station may have been started anew with another one.
    expect(fold([hello()], after).padRevision).toBe(after.padRevision + 1);
  });

  it('takes hello as the whole truth and keeps what a vehicle last said', () => {
    const before = fold([
      { type: 'state', vehicle_id: '1', epoch: 0, mode: 'gps' },
      { type: 'state', vehicle_id: '9', epoch: 0, mode: 'gps' },
      { type: 'target', action: 'created', target: target('old') },
      { type: 'alarm', t_unix_us: 1, ...alarm('a') },
    ]);
    const after = fold(
      [hello({ vehicles: [{ id: '1' }], targets: { type: 'FeatureCollection', features: [target('t')] } })],
      before,
    );
    expect(Object.keys(after.vehicles)).toEqual(['1']);
    expect(after.vehicles['1']?.state?.mode).toBe('gps');
    expect(Object.keys(after.targets)).toEqual(['t']);
    expect(activeAlarms(after)).toEqual([]);
    expect(after.alarms[0]?.cleared_unix_us).toBe(5);
  });

  it('files each message under its vehicle', () => {
    const mission = fold([
      { type: 'gps', vehicle_id: '1', fix_type: 3 },
      { type: 'telemetry', vehicle_id: '1', simulated: true },
      { type: 'link', vehicle_id: '2', connected: true },
      { type: 'video', source: 'cam-2', vehicle_id: null, status: 'flowing' },
      { type: 'fix', vehicle_id: '1', accepted: true },
      { type: 'fix', vehicle_id: '1', accepted: false },
    ]);
    expect(mission.vehicles['1']?.telemetry?.simulated).toBe(true);
    expect(mission.vehicles['1']).toMatchObject({ fixesAccepted: 1, fixesRejected: 1 });
    expect(mission.vehicles['2']?.video?.status).toBe('flowing');
    expect(videoSourceOf(mission.vehicles['1']!)).toBe('cam-1');
  });

  it('raises and clears an alarm in place, newest first', () => {
    const mission = fold([
      { type: 'alarm', t_unix_us: 1, ...alarm('a') },
      { type: 'alarm', t_unix_us: 2, ...alarm('b') },
      { type: 'alarm', t_unix_us: 3, ...alarm('a', false) },
    ]);
    expect(mission.alarms.map((a) => [a.id, a.active])).toEqual([['b', true], ['a', false]]);
    expect(mission.alarms[1]).toMatchObject({ raised_unix_us: 1, cleared_unix_us: 3 });
  });

  it('never keeps more alarms than it can show', () => {
    const many = Array.from({ length: 500 }, (_, i) => ({ type: 'alarm', t_unix_us: i, ...alarm(`a${i}`) }));
    expect(fold(many).alarms).toHaveLength(200);
  });

  it('moves a target with its sightings until it is stopped', () => {
    const sighting = { type: 'sighting', target_id: 't', lat_deg: 58, lon_deg: 15, track: { status: 'seen' } };
    const mission = fold([{ type: 'target', action: 'created', target: target('t') }, sighting]);
    expect(mission.targets['t']?.properties).toMatchObject({ lat_deg: 58, version: 1, track: { status: 'seen' } });
    const stopped = { ...target('t', 2), properties: { version: 2, lat_deg: 58, track: { status: 'stopped' } } };
    const after = fold([{ type: 'target', action: 'updated', target: stopped }, { ...sighting, lat_deg: 59 }], mission);
    expect(after.targets['t']?.properties.lat_deg).toBe(58);
    expect(fold([sighting]).targets).toEqual({});
  });

  it('creates, renames and deletes targets, by id or by object', () => {
    let mission = fold([
      { type: 'target', action: 'created', target: target('t') },
      { type: 'target', action: 'created', target: target('u') },
      { type: 'target', action: 'updated', target: target('t', 2) },
    ]);
    expect(mission.targets['t']?.properties.version).toBe(2);
    mission = fold([{ type: 'target', action: 'deleted', target: 't' }, { type: 'target', action: 'deleted', target: { id: 'u' } }], mission);
    expect(mission.targets).toEqual({});
  });

  it('does not let a late answer overwrite a newer version', () => {
    const targets = withTarget(withTarget({}, target('t', 3)), target('t', 2));
    expect(targets['t']?.properties.version).toBe(3);
  });

  it('keeps a replay that reached its end, and removes what left', () => {
    const ended = fold([{ type: 'replay', vehicle_id: 'replay-f', flight_id: 'f', ended: true }]);
    expect(ended.vehicles['replay-f']?.replay?.ended).toBe(true);
    const mission = fold([
      { type: 'state', vehicle_id: '1', epoch: 0 },
      { type: 'replay', vehicle_id: 'replay-f', flight_id: 'f', paused: false },
      { type: 'vehicle', action: 'deleted', vehicle: 'replay-f' },
      { type: 'vehicle', action: 'deleted', vehicle: { id: '1' } },
    ]);
    expect(mission.vehicles).toEqual({});
  });

  it('says how far a flight has been read until its replay runs', () => {
    const reading = fold([{ type: 'replay_preparing', vehicle_id: 'replay-f', flight_id: 'f', progress: 0.4 }]);
    expect(reading.preparing).toEqual({ f: 0.4 });
    expect(reading.vehicles).toEqual({});
    expect(fold([{ type: 'replay', vehicle_id: 'replay-f', flight_id: 'f' }], reading).preparing).toEqual({});
  });

  it('replaces a map by id', () => {
    const mission = fold([
      { type: 'map', action: 'created', map: { id: 'm', name: 'a' } },
      { type: 'map', action: 'updated', map: { id: 'm', name: 'b' } },
      { type: 'map', action: 'created', map: { id: 'n', name: 'c' } },
      { type: 'map', action: 'deleted', map: 'n' },
    ]);
    expect(mission.maps.map((m) => m.name)).toEqual(['b']);
  });

  it('ignores what it does not know', () => {
    expect(fold([{ type: 'weather' }])).toBe(NO_MISSION);
  });

  it('does not change what it was given', () => {
    const frozen = Object.freeze({ ...NO_MISSION, vehicles: Object.freeze({}), targets: Object.freeze({}) });
    expect(() => fold([{ type: 'state', vehicle_id: '1', epoch: 0 }], frozen as Mission)).not.toThrow();
    expect(frozen.vehicles).toEqual({});
  });
});
