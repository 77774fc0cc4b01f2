/** Encoded pictures in, images out, under one interface: WebCodecs for H.264, the browser's own decoder for JPEG. */

import type { EncodedPicture } from '../source/source';

export type DecoderKind = 'webcodecs' | 'jpeg';

/** A `VideoFrame` or `ImageBitmap`; whoever gets it closes it. */
export type DecodedImage = CanvasImageSource & { close(): void };

export interface DecoderListener {
  decoded(frame_id: number, image: DecodedImage): void;
  /** The decoder is unusable until `reset`; `hopeless` when it never will be usable for this stream. */
  failed(reason: string, hopeless: boolean): void;
}

export interface PictureDecoder {
  readonly kind: DecoderKind;
  /** Pictures given and not yet decoded. */
  readonly queued: number;
  decode(picture: EncodedPicture): void;
  /** Resolves when everything given has come out. The next picture must be a key frame. */
  flush(): Promise<void>;
  /** Forget everything given; the next picture must be a key frame. */
  reset(): void;
  close(): void;
}

export type DecoderFactory = (kind: DecoderKind, listener: DecoderListener) => PictureDecoder;

export function webCodecsAvailable(): boolean {
  // Absent in older browsers and on pages that are neither https nor loopback.
  return typeof VideoDecoder === 'function' && typeof EncodedVideoChunk === 'function';
}

export class WebCodecsDecoder implements PictureDecoder {
  readonly kind = 'webcodecs';
  private decoder: VideoDecoder;
  private configured = '';

  constructor(private readonly listener: DecoderListener) {
    this.decoder = this.create();
  }

  get queued(): number {
    return this.decoder.decodeQueueSize;
  }

  private create(): VideoDecoder {
    const decoder: VideoDecoder = new VideoDecoder({
      // The number travels as the time stamp: identity cannot be lost on the way.
      output: (frame) => {
        if (this.decoder === decoder) this.listener.decoded(frame.timestamp, frame);
        else frame.close();
      },
      error: (error) => {
        if (this.decoder === decoder) this.listener.failed(error.message, error.name === 'NotSupportedError');
      },
    });
    return decoder;
  }

  decode(picture: EncodedPicture): void {
    const { header, payload } = picture;
    if (this.decoder.state === 'closed') return;
    try {
      if (header.key && header.codec_string !== this.configured) {
        // No description: Annex B, with the parameter sets in front of each key frame.
        this.decoder.configure({ codec: header.codec_string, optimizeForLatency: true });
        this.configured = header.codec_string;
      }
      this.decoder.decode(
        new EncodedVideoChunk({ type: header.key ? 'key' : 'delta', timestamp: header.frame_id, data: payload }),
      );
    } catch (error) {
      this.listener.failed(error instanceof Error ? error.message : String(error), error instanceof TypeError);
    }
  }

  async flush(): Promise<void> {
    if (this.decoder.state !== 'configured') return;
    // A reset while flushing rejects; what was wanted has then been replaced by something newer.
    await this.decoder.flush().catch(() => undefined);
  }

  reset(): void {
    this.configured = '';
    if (this.decoder.state === 'closed') this.decoder = this.create();
    else this.decoder.reset();
  }

  close(): void {
    if (this.decoder.state !== 'closed') this.decoder.close();
  }
}

export class JpegDecoder implements PictureDecoder {
  readonly kind = 'jpeg';
  private generation = 0;
  private waiting = new Set<Promise<void>>();

  constructor(
    private readonly listener: DecoderListener,
    private readonly toImage: (jpeg: Uint8Array) => Promise<DecodedImage> = (jpeg) =>
      createImageBitmap(new Blob([jpeg as Uint8Array<ArrayBuffer>], { type: 'image/jpeg' })),
  ) {}

  get queued(): number {
    return this.waiting.size;
  }

  decode(picture: EncodedPicture): void {
    const { generation } = this;
    const work = this.toImage(picture.payload)
      .then((image) => {
        if (generation === this.generation) this.listener.decoded(picture.header.frame_id, image);
        else image.close();
      })
      .catch((error: unknown) => {
        if (generation === this.generation) {
          this.listener.failed(error instanceof Error ? error.message : String(error), false);
        }
      })
      .finally(() => this.waiting.delete(work));
    this.waiting.add(work);
  }

  async flush(): Promise<void> {
    await Promise.all(this.waiting);
  }

  reset(): void {
    this.generation += 1;
    this.waiting = new Set();
  }

  close(): void {
    this.reset();
  }
}

export const browserDecoder: DecoderFactory = (kind, listener) =>
  kind === 'webcodecs' ? new WebCodecsDecoder(listener) : new JpegDecoder(listener);
