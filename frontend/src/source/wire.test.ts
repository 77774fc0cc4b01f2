import { describe, expect, it } from 'vitest';
import type { FrameHeader } from '../api/types';
import { packPicture, parsePicture, WireError } from './wire';

const header: FrameHeader = {
  frame_id: 7,
  epoch: 1,
  t_unix_us: 1_760_000_000_000_000,
  t_wire_unix_us: 1_760_000_000_010_000,
  codec: 'h264',
  codec_string: 'avc1.42c01e',
  key: true,
  width: 640,
  height: 480,
  latency_ms: 10,
};

describe('parsePicture', () => {
  it('reads what was packed', () => {
    const picture = parsePicture(packPicture(header, new Uint8Array([0, 0, 0, 1, 0x67])));
    expect(picture.header).toEqual(header);
    expect([...picture.payload]).toEqual([0, 0, 0, 1, 0x67]);
  });

  it('reads the length as big-endian', () => {
    const text = new TextEncoder().encode(JSON.stringify(header));
    const raw = new Uint8Array([0, 0, text.length >> 8, text.length & 255, ...text, 9]);
    expect([...parsePicture(raw.buffer).payload]).toEqual([9]);
  });

  it.each([
    ['nothing', new Uint8Array(0)],
    ['a length beyond the end', new Uint8Array([0, 0, 1, 0, 123])],
    ['an absurd length', new Uint8Array([255, 255, 255, 255, 0, 0])],
    ['no JSON', new Uint8Array([0, 0, 0, 1, 123])],
    ['a header without its fields', new Uint8Array([0, 0, 0, 2, 123, 125])],
  ])('refuses %s', (_name, bytes) => {
    expect(() => parsePicture(bytes.buffer)).toThrow(WireError);
  });

  it('survives truncation anywhere', () => {
    const whole = packPicture(header, new Uint8Array(0));
    for (let end = 0; end < whole.byteLength; end++) {
      expect(() => parsePicture(whole.slice(0, end))).toThrow(WireError);
    }
  });
});
