/**
 * Live video that can be paused and searched backwards.
 *
 * Live: every picture is decoded as it comes and the newest is drawn at once. When the decoder falls behind, everything up
 * to the next key frame is dropped, so nothing queues up. Paused: the ring goes on filling, and a picture is shown by
 * decoding from the key frame before it. The number of the picture on screen is always known.
 */

import type { FrameHeader } from '../api/types';
import type { EncodedPicture } from '../source/source';
import type { DecodedImage, DecoderFactory, DecoderKind, PictureDecoder } from './decoder';
import { RecentQuantiles, type Quantiles } from './latency';
import { PictureRing } from './ring';

const LONGEST_QUEUE = 6;
const FAILURES_BEFORE_FALLBACK = 3;
const SHOWN_KEPT = 16;
/** A picture farther from a time than this is not the picture of that time. */
const LONGEST_GAP_US = 500_000;
/** Two pictures within one display period: the first would never be seen. */
const SHORTEST_DRAW_PERIOD_MS = 8;

export interface PlayerWorld {
  draw(image: DecodedImage, header: FrameHeader): void;
  now_ms(): number;
  unix_us(): number;
  /** Before the next repaint; returns a cancellation. */
  soon(run: () => void): () => void;
  decoder: DecoderFactory;
}

export interface PlayerListener {
  /** The picture on screen, the mode or the range changed. */
  changed(view: PlayerView): void;
  /** H.264 cannot be decoded here: the owner should ask for JPEG. */
  needsJpeg(reason: string): void;
}

export interface PlayerView {
  paused: boolean;
  shown: FrameHeader | null;
  /** Behind the newest received picture. */
  behind_s: number;
  /** How far back one can go. */
  depth_s: number;
}

export interface PlayerStats {
  drawn: number;
  dropped: number;
  decode_failures: number;
  kind: DecoderKind | null;
  wire_to_drawn_ms: Quantiles;
  wire_to_received_ms: Quantiles;
  received_to_decoded_ms: Quantiles;
}

export class VideoPlayer {
  readonly ring = new PictureRing();
  private decoder: PictureDecoder | null = null;
  private epoch: number | null = null;
  private needKey = true;
  private paused = false;
  private failures = 0;
  private wanted: number | null = null;
  private seeking = false;
  private target: number | null = null;
  private arrived = new Map<number, { header: FrameHeader; at_us: number }>();
  private waitingImage: { image: DecodedImage; header: FrameHeader } | null = null;
  private cancelDraw: (() => void) | null = null;
  private drawnAt_ms = -Infinity;
  private shown: { header: FrameHeader; at_ms: number }[] = [];
  private counts = { drawn: 0, dropped: 0, failed: 0 };
  private readonly wireToDrawn_ms = new RecentQuantiles();
  private readonly wireToReceived_ms = new RecentQuantiles();
  private readonly receivedToDecoded_ms = new RecentQuantiles();

  constructor(
    private readonly world: PlayerWorld,
    private readonly listener: PlayerListener,
  ) {}

  get stats(): PlayerStats {
    return {
      drawn: this.counts.drawn,
      dropped: this.counts.dropped,
      decode_failures: this.counts.failed,
      kind: this.decoder?.kind ?? null,
      wire_to_drawn_ms: this.wireToDrawn_ms.read(),
      wire_to_received_ms: this.wireToReceived_ms.read(),
      received_to_decoded_ms: this.receivedToDecoded_ms.read(),
    };
  }

  get view(): PlayerView {
    const shown = this.shown[this.shown.length - 1]?.header ?? null;
    const newest = this.ring.last?.header;
    const oldest = this.ring.first?.header;
    return {
      paused: this.paused,
      shown,
      behind_s: shown && newest ? Math.max(0, newest.t_wire_unix_us - shown.t_wire_unix_us) / 1e6 : 0,
      depth_s: newest && oldest ? (newest.t_wire_unix_us - oldest.t_wire_unix_us) / 1e6 : 0,
    };
  }

  /** The picture that was on screen at a moment of `performance.now()`, such as an event's time stamp. */
  shownAt(at_ms: number): FrameHeader | null {
    for (let i = this.shown.length - 1; i >= 0; i--) {
      if (this.shown[i]!.at_ms <= at_ms) return this.shown[i]!.header;
    }
    return this.shown[0]?.header ?? null;
  }

  receive(picture: EncodedPicture): void {
    const { header } = picture;
    if (this.epoch !== header.epoch) this.begin(header.epoch);
    this.ring.push(picture);
    const at_us = this.world.unix_us();
    this.wireToReceived_ms.add((at_us - header.t_wire_unix_us) / 1000);
    if (this.paused) {
      this.tell();
      return;
    }
    this.feed(picture, at_us);
  }

  pause(): void {
    if (this.paused || this.shown.length === 0) return;
    this.paused = true;
    this.dropWaiting();
    // What is still in the decoder is newer than what is on screen.
    this.decoder?.reset();
    this.arrived.clear();
    this.tell();
  }

  /** Back to the newest picture. */
  play(): void {
    if (!this.paused) return;
    this.paused = false;
    this.wanted = null;
    this.target = null;
    this.decoder?.reset();
    this.arrived.clear();
    this.needKey = true;
    const { last } = this.ring;
    if (last) for (const picture of this.ring.groupUpTo(last.header.frame_id)) this.feed(picture, this.world.unix_us(), true);
    this.tell();
  }

  step(by: number): void {
    const from = this.wanted ?? this.view.shown?.frame_id;
    if (from === undefined) return;
    const next = this.ring.neighbour(from, by);
    if (next) void this.seek(next.header.frame_id);
  }

  seekBehind(behind_s: number): void {
    const { last } = this.ring;
    if (!last) return;
    const picture = this.ring.before(last.header.t_wire_unix_us - behind_s * 1e6);
    if (picture) void this.seek(picture.header.frame_id);
  }

  /** Shows the picture of a time, paused; returns its number, or null where none is held. */
  seekTime(t_unix_us: number): number | null {
    const picture = this.ring.taken(t_unix_us, LONGEST_GAP_US);
    if (!picture || this.shown.length === 0) return null;
    void this.seek(picture.header.frame_id);
    return picture.header.frame_id;
  }

  /** Shows one picture of the ring, paused. Of many calls in a row the last one counts. */
  async seek(frame_id: number): Promise<void> {
    this.pause();
    if (!this.paused) return;
    this.wanted = frame_id;
    if (this.seeking) return;
    this.seeking = true;
    try {
      while (this.wanted !== null && this.paused) {
        const next: number = this.wanted;
        await this.show(next);
        if (this.wanted === next) this.wanted = null;
      }
    } finally {
      this.seeking = false;
      this.target = null;
    }
  }

  /** Forget the stream, for example because the vehicle changed. */
  clear(): void {
    this.begin(null);
    this.shown = [];
    this.failures = 0;
    this.wireToDrawn_ms.clear();
    this.wireToReceived_ms.clear();
    this.receivedToDecoded_ms.clear();
    this.tell();
  }

  close(): void {
    this.dropWaiting();
    this.decoder?.close();
    this.decoder = null;
  }

  private begin(epoch: number | null): void {
    this.epoch = epoch;
    this.ring.clear();
    this.dropWaiting();
    this.decoder?.reset();
    this.arrived.clear();
    this.needKey = true;
    this.paused = false;
    this.wanted = null;
    this.target = null;
  }

  private feed(picture: EncodedPicture, at_us: number, whole = false): void {
    const { header } = picture;
    if (this.needKey && !header.key) {
      this.counts.dropped += 1;
      return;
    }
    const decoder = this.decoderFor(header);
    if (!whole && decoder.queued >= LONGEST_QUEUE) {
      this.counts.dropped += decoder.queued;
      decoder.reset();
      this.arrived.clear();
      this.needKey = true;
      if (!header.key) {
        this.counts.dropped += 1;
        return;
      }
    }
    this.needKey = false;
    this.arrived.set(header.frame_id, { header, at_us });
    decoder.decode(picture);
  }

  private async show(frame_id: number): Promise<void> {
    const group = this.ring.groupUpTo(frame_id);
    const header = group[group.length - 1]?.header;
    if (!header) return;
    const decoder = this.decoderFor(header);
    decoder.reset();
    this.arrived.clear();
    this.target = frame_id;
    this.arrived.set(frame_id, { header, at_us: this.world.unix_us() });
    for (const picture of group) decoder.decode(picture);
    await decoder.flush();
  }

  private decoderFor(header: FrameHeader): PictureDecoder {
    const kind: DecoderKind = header.codec === 'jpeg' ? 'jpeg' : 'webcodecs';
    if (this.decoder?.kind !== kind) {
      this.decoder?.close();
      this.decoder = this.world.decoder(kind, {
        decoded: (frame_id, image) => this.decoded(frame_id, image),
        failed: (reason, hopeless) => this.failed(kind, reason, hopeless),
      });
    }
    return this.decoder;
  }

  private decoded(frame_id: number, image: DecodedImage): void {
    const arrival = this.arrived.get(frame_id);
    this.failures = 0;
    if (!arrival || (this.paused && frame_id !== this.target)) {
      image.close();
      return;
    }
    // Pictures come out in order; whatever is older was swallowed by the decoder.
    for (const id of this.arrived.keys()) if (id <= frame_id) this.arrived.delete(id);
    if (this.paused) {
      this.draw(image, arrival.header);
      return;
    }
    this.receivedToDecoded_ms.add((this.world.unix_us() - arrival.at_us) / 1000);
    const since_ms = this.world.now_ms() - this.drawnAt_ms;
    if (this.waitingImage === null && since_ms >= SHORTEST_DRAW_PERIOD_MS) {
      this.draw(image, arrival.header);
      return;
    }
    if (this.waitingImage) {
      this.waitingImage.image.close();
      this.counts.dropped += 1;
    }
    this.waitingImage = { image, header: arrival.header };
    this.cancelDraw ??= this.world.soon(() => this.drawWaiting());
  }

  private drawWaiting(): void {
    this.cancelDraw = null;
    const waiting = this.waitingImage;
    this.waitingImage = null;
    if (waiting) this.draw(waiting.image, waiting.header);
  }

  private dropWaiting(): void {
    this.cancelDraw?.();
    this.cancelDraw = null;
    this.waitingImage?.image.close();
    this.waitingImage = null;
  }

  private draw(image: DecodedImage, header: FrameHeader): void {
    this.world.draw(image, header);
    image.close();
    this.drawnAt_ms = this.world.now_ms();
    this.counts.drawn += 1;
    if (!this.paused) this.wireToDrawn_ms.add((this.world.unix_us() - header.t_wire_unix_us) / 1000);
    this.shown.push({ header, at_ms: this.drawnAt_ms });
    if (this.shown.length > SHOWN_KEPT) this.shown.shift();
    this.tell();
  }

  private failed(kind: DecoderKind, reason: string, hopeless: boolean): void {
    this.failures += 1;
    this.counts.failed += 1;
    this.arrived.clear();
    this.needKey = true;
    if (kind === 'webcodecs' && (hopeless || this.failures >= FAILURES_BEFORE_FALLBACK)) {
      this.failures = 0;
      this.listener.needsJpeg(reason);
      return;
    }
    this.decoder?.reset();
  }

  private tell(): void {
    this.listener.changed(this.view);
  }
}
