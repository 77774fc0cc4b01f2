import { beforeEach, describe, expect, it } from 'vitest';
import type { FrameHeader } from '../api/types';
import type { EncodedPicture } from '../source/source';
import type { DecodedImage, DecoderListener, PictureDecoder } from './decoder';
import { VideoPlayer } from './player';

/** Decodes on demand, and like a real decoder only from a key frame on. */
class HandDecoder implements PictureDecoder {
  readonly kind = 'webcodecs';
  waiting: EncodedPicture[] = [];
  given: number[] = [];
  constructor(readonly listener: DecoderListener) {}
  private primed = false;
  get queued() {
    return this.waiting.length;
  }
  decode(picture: EncodedPicture) {
    if (!this.primed && !picture.header.key) throw new Error('a delta frame first');
    this.primed = true;
    this.given.push(picture.header.frame_id);
    this.waiting.push(picture);
  }
  run(count = Infinity) {
    for (let i = 0; i < count && this.waiting.length > 0; i++) {
      const picture = this.waiting.shift()!;
      open += 1;
      this.listener.decoded(picture.header.frame_id, { close: () => void (open -= 1) } as unknown as DecodedImage);
    }
  }
  async flush() {
    await Promise.resolve();
    this.run();
    this.primed = false;
  }
  reset() {
    this.waiting = [];
    this.primed = false;
  }
  close() {
    this.reset();
  }
}

let open = 0;
let drawn: number[];
let now_ms: number;
let soon: (() => void)[];
let jpegWanted: string[];
let decoder: HandDecoder;
let player: VideoPlayer;

const picture = (frame_id: number, epoch = 1): EncodedPicture => ({
  header: {
    frame_id,
    epoch,
    key: frame_id % 25 === 0,
    codec: 'h264',
    codec_string: 'avc1.42c01e',
    t_unix_us: frame_id * 40_000,
    t_wire_unix_us: frame_id * 40_000,
    width: 640,
    height: 480,
    latency_ms: 1,
  } satisfies FrameHeader,
  payload: new Uint8Array(10),
});

function live(from: number, to: number, epoch = 1) {
  for (let id = from; id <= to; id++) {
    now_ms = id * 40 + 20;
    player.receive(picture(id, epoch));
    decoder.run();
  }
}

beforeEach(() => {
  open = 0;
  drawn = [];
  soon = [];
  jpegWanted = [];
  now_ms = 0;
  player = new VideoPlayer(
    {
      draw: (_image, header) => drawn.push(header.frame_id),
      now_ms: () => now_ms,
      unix_us: () => now_ms * 1000,
      soon: (run) => {
        soon.push(run);
        return () => {
          soon = soon.filter((other) => other !== run);
        };
      },
      decoder: (_kind, listener) => (decoder = new HandDecoder(listener)),
    },
    { changed: () => undefined, needsJpeg: (reason) => jpegWanted.push(reason) },
  );
  // Creates the decoder with a first key frame.
  player.receive(picture(0));
});

describe('live', () => {
  it('draws each picture as it is decoded and measures from the wire', () => {
    decoder.run();
    live(1, 10);
    expect(drawn).toEqual([0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10]);
    expect(player.stats.wire_to_drawn_ms).toMatchObject({ count: 11, median: 20 });
    expect(open).toBe(0);
  });

  it('draws only the newest of a burst', () => {
    decoder.run();
    for (const id of [1, 2, 3]) player.receive(picture(id));
    decoder.run();
    soon.forEach((run) => run());
    expect(drawn).toEqual([0, 3]);
    expect(open).toBe(0);
  });

  it('drops to the next key frame when the decoder falls behind', () => {
    decoder.run();
    for (let id = 1; id < 25; id++) player.receive(picture(id));
    expect(decoder.queued).toBeLessThanOrEqual(6);
    player.receive(picture(25));
    player.receive(picture(26));
    decoder.run();
    soon.forEach((run) => run());
    expect(drawn.at(-1)).toBe(26);
    expect(player.stats.dropped).toBeGreaterThan(10);
    expect(open).toBe(0);
  });

  it('begins again in a new epoch and forgets the old ring', () => {
    decoder.run();
    live(1, 30);
    live(60, 74, 2);
    expect(drawn.at(-1)).toBe(30);
    live(75, 80, 2);
    expect(drawn.at(-1)).toBe(80);
    expect(player.ring.first?.header.frame_id).toBe(75);
  });

  it('knows which picture was on screen at a moment', () => {
    decoder.run();
    live(1, 10);
    expect(player.shownAt(5 * 40 + 21)?.frame_id).toBe(5);
    expect(player.shownAt(5 * 40 + 19)?.frame_id).toBe(4);
    expect(player.shownAt(1e9)?.frame_id).toBe(10);
  });
});

describe('paused', () => {
  it('holds the picture while the ring fills', () => {
    decoder.run();
    live(1, 40);
    player.pause();
    live(41, 100);
    expect(drawn.at(-1)).toBe(40);
    expect(player.view).toMatchObject({ paused: true, behind_s: 2.4, depth_s: 4 });
    expect(player.view.shown?.frame_id).toBe(40);
  });

  it('shows exactly the picture that was asked for, from the key frame before it', async () => {
    decoder.run();
    live(1, 100);
    decoder.given = [];
    await player.seek(52);
    expect(decoder.given).toEqual([50, 51, 52]);
    expect(player.view.shown?.frame_id).toBe(52);
    expect(player.shownAt(now_ms)?.frame_id).toBe(52);
    expect(open).toBe(0);
  });

  it('goes to the last of many requests', async () => {
    decoder.run();
    live(1, 100);
    const first = player.seek(10);
    void player.seek(20);
    void player.seek(33);
    await first;
    expect(drawn.slice(-2)).toEqual([10, 33]);
  });

  it('steps and goes back by seconds', async () => {
    decoder.run();
    live(1, 100);
    await player.seek(60);
    player.step(-3);
    await new Promise((resolve) => setTimeout(resolve));
    expect(player.view.shown?.frame_id).toBe(57);
    player.seekBehind(2);
    await new Promise((resolve) => setTimeout(resolve));
    expect(player.view.shown?.frame_id).toBe(50);
  });

  it('returns to the newest picture and goes on', async () => {
    decoder.run();
    live(1, 100);
    await player.seek(30);
    player.play();
    decoder.run();
    soon.forEach((run) => run());
    expect(drawn.at(-1)).toBe(100);
    live(101, 110);
    expect(drawn.at(-1)).toBe(110);
    expect(player.view).toMatchObject({ paused: false, behind_s: 0 });
    expect(open).toBe(0);
  });

  it('cannot pause before there is a picture', () => {
    player.pause();
    expect(player.view.paused).toBe(false);
  });
});

describe('failure', () => {
  it('starts again at the next key frame', () => {
    decoder.run();
    live(1, 3);
    decoder.listener.failed('broken', false);
    live(4, 30);
    expect(drawn.slice(-7)).toEqual([3, 25, 26, 27, 28, 29, 30].slice(0));
    expect(jpegWanted).toEqual([]);
  });

  it('asks for JPEG after repeated failure, or at once when there is no hope', () => {
    decoder.listener.failed('a', false);
    decoder.listener.failed('b', false);
    expect(jpegWanted).toEqual([]);
    decoder.listener.failed('c', false);
    decoder.listener.failed('not supported', true);
    expect(jpegWanted).toEqual(['c', 'not supported']);
  });

  it('shows the picture of a time, and says where it has none', async () => {
    live(0, 60);
    expect(player.seekTime(31 * 40_000 + 15_000)).toBe(31);
    await Promise.resolve();
    await Promise.resolve();
    await Promise.resolve();
    expect(player.view.shown?.frame_id).toBe(31);
    expect(player.view.paused).toBe(true);
    expect(player.seekTime(60 * 40_000 + 600_000)).toBeNull();
  });
});
