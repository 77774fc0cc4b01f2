import { describe, expect, it } from 'vitest';
import type { LinkMessage, StateMessage, TargetTrack, VideoMessage } from '../api/types';
import { newVehicle } from './mission';
import { boresightWords, connectionWords, fixAgeTone, freshModeWords, linkWords, methodWords, modeWords, registrationWords, trackWords, vehicleWords, videoClockWords, videoWords } from './words';

const vehicle = (fields: object) => ({ ...newVehicle('1'), ...fields });
const state = (fields: object) => vehicle({ state: { mode: 'gps', gps_denied: false, last_fix_age_s: 0.4, ...fields } as StateMessage });

describe('modeWords', () => {
  it('says what the position rests on', () => {
    expect(modeWords(null).text).toBe('NO ESTIMATE');
    expect(modeWords(vehicle({ replay: { progress: 0.137 } })).text).toBe('ESTIMATING 13 %');
    expect(modeWords(state({})).text).toBe('GPS');
    expect(modeWords(state({ mode: 'vision', gps_denied: true })).text).toBe('VISION – GPS denied');
    expect(modeWords(state({ mode: 'vision' })).text).toBe('VISION – no GPS');
    expect(modeWords(state({ mode: 'dead_reckoning', last_fix_age_s: 75 }))).toMatchObject({ text: 'DEAD RECKONING', tone: 'watch' });
    expect(modeWords(state({ mode: 'dead_reckoning', last_fix_age_s: 75 })).detail).toContain('1 min 15 s');
    expect(modeWords(state({ mode: 'lost', gps_denied: true })).tone).toBe('bad');
  });
});

describe('freshModeWords', () => {
  it('does not let old data look alive', () => {
    expect(freshModeWords(state({}), 0.3, true)).toMatchObject({ text: 'GPS', stale: false });
    expect(freshModeWords(state({}), 7, true)).toMatchObject({ text: 'STALE 7.0 s', stale: true, tone: 'bad' });
    expect(freshModeWords(state({}), 0.3, false).stale).toBe(true);
  });

  it('lets a paused replay stand still', () => {
    const paused = { ...state({}), replay: { paused: true } as never };
    expect(freshModeWords(paused, 60, true).stale).toBe(false);
    expect(freshModeWords(null, null, false)).toMatchObject({ text: 'NO ESTIMATE', stale: false });
  });
});

describe('linkWords', () => {
  const link = (fields: object) =>
    linkWords(vehicle({ link: { connected: true, messages_per_s: 142.3, loss_pct: 0, heartbeat_age_s: 0.5, ...fields } as LinkMessage }));

  it('shows rate, loss and silence', () => {
    expect(linkWords(null).tone).toBe('none');
    expect(link({})).toMatchObject({ text: '142 msg/s', tone: 'good' });
    expect(link({ loss_pct: 8.25 })).toMatchObject({ text: '142 msg/s · 8.3 % lost', tone: 'watch' });
    expect(link({ connected: false, heartbeat_age_s: 7.2 })).toMatchObject({ text: 'Lost 7.2 s', tone: 'bad' });
    expect(link({ signed: true, endpoint: 'udpin:0.0.0.0:14550' }).detail).toContain('signed');
  });

  it('says that a replay has no link', () => {
    expect(linkWords(newVehicle('replay-f')).text).toBe('Replay');
  });
});

describe('videoWords', () => {
  const video = (fields: object) =>
    videoWords(vehicle({ video: { source: 'cam-1', status: 'flowing', fps: 24.9, width: 640, height: 480, ...fields } as VideoMessage }));

  it('shows each state', () => {
    expect(videoWords(null).text).toBe('Waiting');
    expect(video({})).toMatchObject({ text: '25 fps 640×480', tone: 'good' });
    expect(video({ status: 'frozen' }).tone).toBe('bad');
    const stopped = { source: 'cam-r', status: 'stopped', width: 640, height: 480 } as VideoMessage;
    const replay = (fields: object) => videoWords(vehicle({ video: stopped, replay: fields })).text;
    expect([replay({ paused: true }), replay({ paused: false, ended: true })]).toEqual(['Paused 640×480', 'At the end 640×480']);
    expect(video({ status: 'stopped', last_frame_age_s: 12 }).text).toBe('Stopped 12 s');
  });
});

describe('videoClockWords', () => {
  const clock = (fields: object) =>
    videoClockWords({ video_clock: { source: 'found', time_offset_s: -0.1213, std_s: 0.0042, reason: '', ...fields } } as StateMessage);

  it('gives offset and sigma once found', () => {
    expect(clock({})).toMatchObject({ text: '−0.121 ± 0.004 s', tone: 'good' });
    expect(clock({ time_offset_s: 0.0504 })!.text).toBe('+0.050 ± 0.004 s');
    expect(clock({ time_offset_s: -0.0001 })!.text).toBe('0.000 ± 0.004 s');
  });

  it('says plainly that it is not known, and why', () => {
    const words = clock({ source: 'searching', time_offset_s: null, std_s: null, reason: 'the motion does not tell' })!;
    expect(words).toMatchObject({ text: 'not known yet', tone: 'watch' });
    expect(words.detail).toContain('so far: the motion does not tell');
    expect(clock({ source: 'searching', time_offset_s: null, std_s: null })!.detail).not.toContain('so far');
  });

  it('tells what was configured or stamped from what was measured', () => {
    expect(clock({ source: 'given', time_offset_s: 0.25, std_s: null })!.text).toBe('+0.250 s, as configured');
    expect(clock({ source: 'stamped', time_offset_s: 0, std_s: null })!.text).toBe("the vehicle's own");
    expect([videoClockWords(null), videoClockWords({} as StateMessage), videoClockWords({ video_clock: null } as StateMessage)]).toEqual([null, null, null]);
  });
});

describe('boresightWords', () => {
  const boresight = (deg: (number | null)[], std: (number | null)[]) =>
    boresightWords({ boresight_deg: deg, boresight_std_deg: std } as StateMessage)!;

  it('gives three angles with the largest of their sigmas', () => {
    expect(boresight([0.31, -0.2, 0.1], [0.08, 0.12, 0.1])).toMatchObject({ text: '+0.3 / −0.2 / +0.1 ° ± 0.1', tone: 'good' });
  });

  it('does not give what is not known', () => {
    expect(boresight([0, 0, 0], [0.57, 0.57, 0.57]).text).toBe('not known yet');
    const partly = boresight([0.31, -0.2, 0.4], [0.1, 0.1, 0.55]);
    expect(partly).toMatchObject({ text: '+0.3 / −0.2 / ? ° ± 0.1', tone: 'none' });
    expect(partly.detail).toContain('+0.40 ± 0.55°');
    expect(boresight([null, null, null], [null, null, null]).text).toBe('not known yet');
    expect([boresightWords(null), boresightWords({ boresight_deg: null } as StateMessage)]).toEqual([null, null]);
  });
});

it('speaks of the connection, of fixes, methods and vehicles', () => {
  expect(connectionWords({ phase: 'retrying', attempt: 2, retry_in_ms: 1600, reason: 'gone' })).toEqual({
    text: 'Station lost – retry in 1.6 s',
    detail: 'gone; attempt 2',
    tone: 'bad',
  });
  expect([0.5, 8, 60, null].map(fixAgeTone)).toEqual(['good', 'watch', 'bad', 'none']);
  expect([methodWords('ray_terrain'), methodWords('line_of_sight')]).toEqual(['ray to terrain', 'line of sight']);
  expect(registrationWords('waiting', 0)).toBe('matching the map…');
  expect([registrationWords('matched by windows', 1), registrationWords('no match: weak', 2)]).toEqual(['refined', 'refined 2 times']);
  expect([registrationWords('no match: weak', 0), registrationWords(null, 0)]).toEqual(['no match: weak', null]);
  expect(vehicleWords(vehicle({ telemetry: { vehicle_type: 'helicopter', simulated: true } }))).toBe('1 · helicopter (sim)');
  expect(vehicleWords(newVehicle('replay-f1'))).toBe('Replay f1');
});

it('says of a followed target whether it is seen, stands or moves', () => {
  const track = (fields: Partial<TargetTrack>) =>
    trackWords({ status: 'seen', reason: null, moving: null, speed_m_s: null, course_deg: null, ...fields } as TargetTrack);
  expect(track({})).toBe('seen');
  expect(track({ moving: false })).toBe('standing');
  expect(track({ moving: true, speed_m_s: 8.24, course_deg: 44.6 })).toBe('moving 8.2 m/s, 45°');
  expect(track({ status: 'lost', reason: 'outside the picture', moving: true, speed_m_s: 8, course_deg: 1 })).toBe('lost: outside the picture');
  expect(track({ status: 'stopped', reason: 'moved by hand' })).toBe('not followed: moved by hand');
});
