import { describe, expect, it } from 'vitest';
import type { AckMessage } from '../api/types';
import { acknowledged, asked, heard, reasonOf, refused, sent, type CommandLog } from './commands';

function ack(command_id: string, status: string, command = 'arm', text = ''): AckMessage {
  return { type: 'ack', seq: 1, t_unix_us: 1, command_id, vehicle_id: '1', command, status, text };
}

const ASKED = asked([], 'k1', '1', 'Arm', 1000);

describe('commands', () => {
  it('is sending, pending, in progress and accepted, one after the other', () => {
    expect(ASKED[0]!.state).toBe('sending');
    const pending = sent(ASKED, 'k1', 'c1');
    expect(pending[0]!.state).toBe('pending');
    const progress = acknowledged(pending, ack('c1', 'in_progress'), 1200);
    expect(progress[0]!.state).toBe('in_progress');
    const done = acknowledged(progress, ack('c1', 'accepted'), 1300);
    expect(done).toHaveLength(1);
    expect(done[0]).toMatchObject({ state: 'accepted', reason: '', asked_ms: 1000, changed_ms: 1300 });
  });

  it('takes an acknowledgement that is faster than the answer to the request', () => {
    const early = acknowledged(ASKED, ack('c1', 'denied'), 1100);
    expect(early).toHaveLength(2);
    const one = sent(early, 'k1', 'c1');
    expect(one).toHaveLength(1);
    expect(one[0]).toMatchObject({ key: 'k1', words: 'Arm', state: 'rejected', changed_ms: 1100 });
  });

  it('keeps the words of the vehicle with what they are about, before or after the refusal', () => {
    const before = acknowledged(heard(sent(ASKED, 'k1', 'c1'), '1', 'PreArm: compass', 1100), ack('c1', 'denied'), 1150);
    expect(reasonOf(before[0]!)).toBe('the autopilot denied it (“PreArm: compass”)');
    const after = heard(acknowledged(sent(ASKED, 'k1', 'c1'), ack('c1', 'denied'), 1150), '1', 'PreArm: compass', 1200);
    expect(reasonOf(after[0]!)).toBe('the autopilot denied it (“PreArm: compass”)');
    const late = heard(acknowledged(sent(ASKED, 'k1', 'c1'), ack('c1', 'denied'), 1150), '1', 'Low battery', 4200);
    expect(reasonOf(late[0]!)).toBe('the autopilot denied it');
    const other = heard(sent(ASKED, 'k1', 'c1'), '2', 'PreArm: compass', 1100);
    expect(other[0]!.heard).toBe('');
  });

  it('says nothing of warnings beside what was accepted', () => {
    const log = heard(acknowledged(sent(ASKED, 'k1', 'c1'), ack('c1', 'accepted'), 1150), '1', 'Low battery', 1200);
    expect(reasonOf(log[0]!)).toBe('');
  });

  it('names each way of being refused, and a time-out apart', () => {
    const of = (status: string) => acknowledged(sent(ASKED, 'k1', 'c1'), ack('c1', status), 1150)[0]!;
    expect(of('unsupported')).toMatchObject({ state: 'rejected', reason: 'this autopilot does not know the command' });
    expect(of('timeout').state).toBe('timeout');
    expect(of('temporarily_rejected').reason).toMatch(/not now/);
    expect(refused(ASKED, 'k1', 'not connected', 1100)[0]).toMatchObject({ state: 'rejected', reason: 'not connected' });
  });

  it('shows what others command, and the story of a plan in the words of the station', () => {
    const log = acknowledged([], ack('x', 'failed', 'plan_upload', 'item 3 is refused'), 1);
    expect(log[0]).toMatchObject({ words: 'Send the plan', state: 'rejected', reason: 'item 3 is refused' });
  });

  it('keeps the last dozen', () => {
    let log: CommandLog = [];
    for (let i = 0; i < 30; i++) log = asked(log, `k${i}`, '1', 'Arm', i);
    expect(log).toHaveLength(12);
    expect(log[0]!.key).toBe('k29');
  });
});
