/** The video socket's binary frame: uint32 big-endian header length, UTF-8 JSON header, payload. Pure. */

import type { FrameHeader } from '../api/types';
import type { EncodedPicture } from './source';

const LONGEST_HEADER_BYTES = 65_536;

export class WireError extends Error {}

export function parsePicture(data: ArrayBuffer): EncodedPicture {
  if (data.byteLength < 4) throw new WireError(`a picture message of ${data.byteLength} bytes has no header`);
  const length = new DataView(data).getUint32(0);
  if (length > LONGEST_HEADER_BYTES || 4 + length > data.byteLength) {
    throw new WireError(`a picture header of ${length} bytes does not fit in ${data.byteLength}`);
  }
  let header: Partial<FrameHeader>;
  try {
    header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))) as Partial<FrameHeader>;
  } catch {
    throw new WireError('a picture header is not JSON');
  }
  if (
    !Number.isSafeInteger(header.frame_id) ||
    typeof header.key !== 'boolean' ||
    (header.codec !== 'h264' && header.codec !== 'jpeg')
  ) {
    throw new WireError('a picture header lacks frame_id, key or a known codec');
  }
  return { header: header as FrameHeader, payload: new Uint8Array(data, 4 + length) };
}

/** The inverse, for the fake source and the tests. */
export function packPicture(header: FrameHeader, payload: Uint8Array): ArrayBuffer {
  const text = new TextEncoder().encode(JSON.stringify(header));
  const data = new Uint8Array(4 + text.length + payload.length);
  new DataView(data.buffer).setUint32(0, text.length);
  data.set(text, 4);
  data.set(payload, 4 + text.length);
  return data.buffer;
}
