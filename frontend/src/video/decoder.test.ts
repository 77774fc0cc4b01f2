import { describe, expect, it, vi } from 'vitest';
import type { EncodedPicture } from '../source/source';
import { JpegDecoder, type DecodedImage } from './decoder';

const picture = (frame_id: number) => ({ header: { frame_id }, payload: new Uint8Array([frame_id]) }) as EncodedPicture;

describe('JpegDecoder', () => {
  it('hands over each image with its number', async () => {
    const seen: number[] = [];
    const decoder = new JpegDecoder(
      { decoded: (id) => seen.push(id), failed: () => undefined },
      () => Promise.resolve({ close: () => undefined } as DecodedImage),
    );
    decoder.decode(picture(1));
    decoder.decode(picture(2));
    expect(decoder.queued).toBe(2);
    await decoder.flush();
    expect(seen).toEqual([1, 2]);
    expect(decoder.queued).toBe(0);
  });

  it('closes what arrives after a reset', async () => {
    const close = vi.fn();
    const decoded = vi.fn();
    let finish: (image: DecodedImage) => void = () => undefined;
    const decoder = new JpegDecoder(
      { decoded, failed: () => undefined },
      () => new Promise((resolve) => (finish = resolve)),
    );
    decoder.decode(picture(1));
    const flushed = decoder.flush();
    decoder.reset();
    finish({ close } as unknown as DecodedImage);
    await flushed;
    expect(decoded).not.toHaveBeenCalled();
    expect(close).toHaveBeenCalledOnce();
  });

  it('reports a broken picture and goes on', async () => {
    const failed = vi.fn();
    const decoder = new JpegDecoder({ decoded: () => undefined, failed }, () => Promise.reject(new Error('broken')));
    decoder.decode(picture(1));
    await decoder.flush();
    expect(failed).toHaveBeenCalledWith('broken', false);
  });
});
