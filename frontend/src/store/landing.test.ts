import { describe, expect, it } from 'vitest';
import type { Landing, LandingMessage } from '../api/types';
import { aidingWords, crossAt, descentWords, heightStep, moveWords, PadOutlines, padWords, tapeMarks } from './landing';

const LANDING: Landing = {
  vehicle_id: '1',
  t_state_unix_us: 1_000_000,
  pad: 'field',
  mode: 'tracking',
  reason: '',
  age_s: 0.04,
  north_m: 0.6,
  east_m: -0.4,
  height_m: 8,
  sink_m_s: 0.5,
  speed_m_s: 0.3,
  ahead_m: 0.42,
  right_m: -0.1,
  x_m: 0.6,
  y_m: -0.4,
  heading_on_pad_deg: 0,
  std_horizontal_m: 0.05,
  std_height_m: 0.02,
  std_velocity_m_s: 0.04,
  coast_left_s: null,
  descent: null,
  gaze: null,
  outlines_px: null,
  seen: null,
  aiding: { on: false, form: null, sending: false, sent: 0, reason: '' },
};

function seenIn(frame_id: number, t_frame_unix_us: number): LandingMessage {
  const seen = { frame_id, t_frame_unix_us, width_px: 640, height_px: 480, triple: 0, seen_share: 0.9, outlines_px: [[[0, 0], [639, 479]]] as [number, number][][] };
  return { type: 'landing', seq: 1, t_unix_us: 1, ...LANDING, seen };
}

describe('padWords', () => {
  it('says what is wrong before it says how well it goes', () => {
    expect(padWords({ ...LANDING, pad: null }).text).toBe('NO PAD');
    expect(padWords(null).tone).toBe('none');
    expect(padWords({ ...LANDING, mode: 'searching', reason: 'a mirrored print' }).detail).toContain('A mirrored print.');
    expect(padWords({ ...LANDING, mode: 'dead_reckoning', age_s: 1.5 })).toMatchObject({ text: 'DEAD RECKONING', tone: 'watch' });
    expect(padWords({ ...LANDING, mode: 'dead_reckoning', age_s: 1.5 }).detail).toContain('1.5 s ago');
    expect(padWords({ ...LANDING, mode: 'dead_reckoning', age_s: 1.5, coast_left_s: 4.21 }).text).toBe('DEAD RECKONING 4.2 s left');
    expect(padWords({ ...LANDING, mode: 'lost' }).tone).toBe('bad');
    expect(padWords(LANDING)).toMatchObject({ text: 'TRACKING', tone: 'good' });
    expect(padWords({ ...LANDING, mode: null }).text).toBe('WAITING');
  });
});

describe('aidingWords', () => {
  it('never calls it sending while nothing goes out', () => {
    expect(aidingWords(LANDING).text).toBe('off');
    const on = { on: true, form: 'body' as const, sending: false, sent: 12, reason: 'the pad is lost' };
    expect(aidingWords({ ...LANDING, aiding: on })).toMatchObject({ text: 'waiting', tone: 'watch' });
    expect(aidingWords({ ...LANDING, aiding: on }).detail).toContain('the pad is lost');
    expect(aidingWords({ ...LANDING, aiding: { ...on, sending: true, reason: '' } })).toMatchObject({ text: 'sending · 12', tone: 'good' });
    expect(aidingWords({ ...LANDING, aiding: { ...on, sending: true, form: 'local' } }).detail).toContain('PX4');
  });
});

describe('descentWords', () => {
  const descent = { active: true, phase: 'descend' as const, reason: '', set_point_ned_m_s: [0, 0, 0.5] as [number, number, number] };

  it('says how far it is and why it holds', () => {
    expect(descentWords(descent)).toMatchObject({ text: 'DESCENDING', detail: '', tone: 'good' });
    expect(descentWords({ ...descent, reason: 'pad out of sight for 0.6 s' })).toMatchObject({ detail: 'Pad out of sight for 0.6 s.', tone: 'watch' });
    expect(descentWords({ ...descent, phase: 'touchdown' })?.text).toBe('TOUCHING DOWN');
    expect(descentWords({ ...descent, phase: 'hold', reason: 'the operator ended it' })).toEqual({ text: 'HOLDING BY VISION', detail: 'The operator ended it.', tone: 'watch' });
  });

  it('says how it has ended', () => {
    expect(descentWords({ ...descent, active: false, phase: 'landed' })).toMatchObject({ text: 'LANDED', tone: 'good' });
    expect(descentWords({ ...descent, active: false, phase: 'abort', reason: 'the operator ended it' })).toMatchObject({ text: 'LANDING ENDED', tone: 'bad' });
    expect(descentWords(null)).toBeNull();
  });
});

it('says where to move as the vehicle heads', () => {
  expect(moveWords(LANDING)).toBe('0.42 m ahead, 0.10 m left');
  expect(moveWords({ ahead_m: -1, right_m: 2 })).toBe('1.00 m back, 2.00 m right');
  expect(moveWords({ ahead_m: null, right_m: 2 })).toBe('–');
});

describe('tapeMarks', () => {
  it('has larger values above, the value itself in the middle', () => {
    const marks = tapeMarks(8, 0.5, 28, 60);
    expect(marks.find((mark) => mark.label === '9')?.y).toBe(-28);
    expect(marks.find((mark) => mark.label === '7')?.y).toBe(28);
    expect(marks.find((mark) => mark.y === 0)?.label).toBe('8');
    expect(marks.every((mark) => Math.abs(mark.y) <= 60)).toBe(true);
  });

  it('goes through zero without a negative one', () => {
    const labels = tapeMarks(0.03, 0.1, 120, 60).map((mark) => mark.label);
    expect(labels).toContain('0.0');
    expect(labels).not.toContain('-0.0');
    expect(labels).toContain('−0.4');
  });

  it('is finer near the ground', () => {
    expect([20, 5, 1].map(heightStep)).toEqual([1, 0.5, 0.1]);
  });
});

describe('crossAt', () => {
  it('draws x of the pad upwards and y to the right', () => {
    expect(crossAt({ x_m: 0.5, y_m: -0.2 }, 3)).toEqual({ x: -0.2, y: -0.5, outside: false });
  });

  it('stays on the edge in the direction of what lies beyond', () => {
    const cross = crossAt({ x_m: 6, y_m: 3 }, 3)!;
    expect(cross.outside).toBe(true);
    expect(cross.y).toBeCloseTo(-1.41);
    expect(cross.x).toBeCloseTo(0.705);
  });

  it('draws nothing of an unknown place', () => {
    expect(crossAt({ x_m: null, y_m: 1 }, 3)).toBeNull();
  });
});

describe('PadOutlines', () => {
  const VGA = { width: 640, height: 480 };

  it('draws what was found in the shown picture, or where the estimate of that time has it', () => {
    const book = new PadOutlines();
    const estimate: [number, number][][] = [[[5, 5]]];
    expect(book.take({ ...seenIn(10, 1_000_000), t_state_unix_us: 1_400_000, outlines_px: estimate })).toBe(true);

    expect(book.at('1', { frame_id: 10, t_unix_us: 1_000_000 }, VGA)).toMatchObject({ exact: true, outlines: [[[0, 0], [639, 479]]] });
    expect(book.at('1', { frame_id: 20, t_unix_us: 1_380_000 }, VGA)).toMatchObject({ exact: false, outlines: [[[5, 5]]] });
    expect(book.at('1', { frame_id: 12, t_unix_us: 1_080_000 }, VGA)).toBeNull();
    expect(book.at('1', { frame_id: 40, t_unix_us: 2_000_000 }, VGA)).toBeNull();
    expect(book.at('2', { frame_id: 10, t_unix_us: 1_000_000 }, VGA)).toBeNull();
  });

  it('draws no estimate where there is none', () => {
    const book = new PadOutlines();
    book.take({ ...seenIn(10, 1_000_000), t_state_unix_us: 1_400_000, outlines_px: null });
    expect(book.at('1', { frame_id: 20, t_unix_us: 1_400_000 }, VGA)).toBeNull();
  });

  it('follows the size of the shown picture, pixel centres at whole numbers', () => {
    const book = new PadOutlines();
    book.take(seenIn(10, 1_000_000));
    const mark = book.at('1', { frame_id: 10, t_unix_us: 1_000_000 }, { width: 1280, height: 960 });
    expect(mark?.outlines).toEqual([[[0.5, 0.5], [1278.5, 958.5]]]);
  });

  it('begins again when the station numbers its pictures anew', () => {
    const book = new PadOutlines();
    book.take(seenIn(500, 9_000_000));
    book.take(seenIn(3, 1_000_000));
    expect(book.at('1', { frame_id: 500, t_unix_us: 9_000_000 }, VGA)).toBeNull();
    expect(book.at('1', { frame_id: 3, t_unix_us: 1_000_000 }, VGA)).not.toBeNull();
  });
});
