import { beforeEach, describe, expect, it } from 'vitest';
import type { FrameHeader, ReplayMessage } from '../api/types';
import type { PlayerView } from '../video/player';
import { TimeCursor, type PictureDeck, type TimeSource } from './time.svelte';

/** Pictures every 100 ms from 50 s on; the newest is the source's newest. */
class Deck implements PictureDeck {
  view: PlayerView = { paused: false, shown: null, behind_s: 0, depth_s: 0 };
  calls: string[] = [];
  cursor: TimeCursor | null = null;

  show(frame_id: number, paused = this.view.paused): void {
    this.view = { ...this.view, paused, shown: { frame_id, t_unix_us: frame_id * 100_000, epoch: 1 } as FrameHeader };
    this.cursor!.playerChanged(this.view);
  }

  seekTime(t_us: number): number | null {
    const frame_id = Math.round(t_us / 100_000);
    if (frame_id < 500) return null;
    this.pause();
    return frame_id;
  }

  pause(): void {
    this.view = { ...this.view, paused: true };
    this.cursor!.playerChanged(this.view);
  }

  play(): void {
    this.calls.push('play');
    this.view = { ...this.view, paused: false };
    this.cursor!.playerChanged(this.view);
  }

  step(by: number): void {
    this.show(this.view.shown!.frame_id + by, true);
  }
}

let source: TimeSource;
let deck: Deck;
let cursor: TimeCursor;
let asked: [string, number | boolean][];

const clock = {
  t_ms: 0,
  due: [] as { at_ms: number; run: () => void }[],
  now_ms: () => clock.t_ms,
  after: (ms: number, run: () => void) => {
    const one = { at_ms: clock.t_ms + ms, run };
    clock.due.push(one);
    return () => void (clock.due = clock.due.filter((other) => other !== one));
  },
  run: (ms: number) => {
    clock.t_ms += ms;
    const now = clock.due.filter((one) => one.at_ms <= clock.t_ms);
    clock.due = clock.due.filter((one) => one.at_ms > clock.t_ms);
    for (const one of now) one.run();
  },
};
const settled = async () => {
  for (let i = 0; i < 5; i++) await Promise.resolve();
};

beforeEach(() => {
  source = { vehicle_id: '1', first_us: 10e6, last_us: 100e6, replay: null };
  deck = new Deck();
  asked = [];
  cursor = new TimeCursor(() => source, {
    seek: (_id, t_us) => (asked.push(['seek', t_us]), Promise.resolve()),
    pause: (_id, paused) => (asked.push(['pause', paused]), Promise.resolve()),
  }, clock);
  deck.cursor = cursor;
  cursor.lend(deck);
  deck.show(1000);
});

describe('TimeCursor', () => {
  it('is live until a time is asked for, and then stays there whatever comes', () => {
    expect(cursor.past).toBe(false);
    expect(cursor.shown_us).toBe(100e6);
    cursor.scrub(60e6);
    const held = cursor.view();
    source = { ...source, last_us: 140e6 };
    expect(cursor.at_us).toBe(60e6);
    expect(cursor.view()).toEqual(held);
    expect(cursor.behind_s).toBe(80);
  });

  it('does not take the picture that is still on screen for the one that was asked for', () => {
    cursor.scrub(60e6);
    deck.show(1000, true);
    deck.show(700, true);
    expect(cursor.at_us).toBe(60e6);
    deck.show(600, true);
    expect(cursor.at_us).toBe(60e6);
    deck.step(-1);
    expect(cursor.at_us).toBe(59.9e6);
    expect(cursor.pictureHeld).toBe(true);
  });

  it('says where the picture is gone, and has it again where it is held', () => {
    cursor.scrub(20e6);
    expect(cursor.at_us).toBe(20e6);
    expect(cursor.pictureHeld).toBe(false);
    expect(deck.view.paused).toBe(true);
    cursor.step(1);
    expect(cursor.at_us).toBe(21e6);
    cursor.scrub(70e6);
    expect(cursor.pictureHeld).toBe(true);
  });

  it('keeps within what is known', () => {
    cursor.scrub(-5);
    expect(cursor.at_us).toBe(10e6);
    cursor.scrub(1e9);
    expect(cursor.at_us).toBe(100e6);
  });

  it('pauses on the picture of the screen and returns to now', () => {
    cursor.toggle();
    expect(cursor.at_us).toBe(100e6);
    cursor.toggle();
    expect(cursor.past).toBe(false);
    expect(deck.calls).toEqual(['play']);
  });

  it('stays in the past when the stream begins anew, without its picture', () => {
    cursor.scrub(60e6);
    deck.show(600, true);
    deck.show(1001, false);
    expect(cursor.at_us).toBe(60e6);
    expect(cursor.pictureHeld).toBe(false);
  });

  it('moves the window by just as much as a step leaves it', () => {
    cursor.setWindow(60e6);
    cursor.scrub(45e6);
    const before = cursor.view()!;
    cursor.scrub(20e6);
    const after = cursor.view()!;
    expect(before.from_us).toBeCloseTo(100e6 - 0.99 * 60e6);
    expect(after.from_us).toBe(20e6);
    expect(after.to_us - after.from_us).toBeCloseTo(60e6);
  });

  it('moves a replay itself, one request at a time', async () => {
    source.replay = { start_unix_us: 0, end_unix_us: 200e6, t_unix_us: 30e6, paused: false, ended: false } as ReplayMessage;
    cursor.scrub(70e6);
    cursor.scrub(90e6);
    cursor.scrub(900e6);
    expect(cursor.past).toBe(false);
    expect(cursor.shown_us).toBe(200e6);
    expect(asked).toEqual([['seek', 70e6]]);
    await settled();
    clock.run(80);
    expect(asked).toEqual([['seek', 70e6], ['seek', 200e6]]);
    await settled();
    clock.run(250);
    expect(cursor.shown_us).toBe(30e6);
    cursor.toggle();
    expect(asked.at(-1)).toEqual(['pause', true]);
  });

  it('forgets the past of another vehicle', () => {
    cursor.scrub(60e6);
    cursor.reset();
    expect(cursor.past).toBe(false);
  });
});
