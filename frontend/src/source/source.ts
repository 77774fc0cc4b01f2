/**
 * What the console listens to: a live station (its replays included) or, in development, a fake one.
 *
 * `messages` returns a promise, and no further batch comes before it is kept: that is the back-pressure. Meanwhile the
 * source keeps only the latest of what may be coalesced and everything of what must not be lost.
 */

import type { FrameHeader, StationMessage } from '../api/types';

export type ConnectionPhase = 'connecting' | 'open' | 'retrying' | 'closed';

export interface ConnectionStatus {
  phase: ConnectionPhase;
  /** Failed attempts since the last success. */
  attempt: number;
  /** Only while retrying. */
  retry_in_ms: number | null;
  /** Why the last connection ended, in plain words; empty at first. */
  reason: string;
}

export interface MessageListener {
  status(status: ConnectionStatus): void;
  messages(batch: StationMessage[]): Promise<void>;
}

export type VideoCodec = 'h264' | 'jpeg';

export interface EncodedPicture {
  header: FrameHeader;
  payload: Uint8Array;
}

export interface VideoListener {
  status(status: ConnectionStatus): void;
  picture(picture: EncodedPicture): void;
}

/** Something open that can be closed; closing twice does no harm. */
export interface Feed {
  close(): void;
}

export interface Source {
  openMessages(listener: MessageListener): Feed;
  openVideo(source: string, codec: VideoCodec, listener: VideoListener): Feed;
}
