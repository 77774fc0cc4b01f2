import { describe, expect, it } from 'vitest';
import type { Aiding, AidingCheck } from '../api/types';
import { aidingEffect, aidingGap, checkWords } from './aiding';

const AIDING: Aiding = {
  vehicle_id: '1',
  on: true,
  form: 'external_position',
  last_resort: false,
  sending: true,
  sent: 12,
  reason: '',
  accepted: 12,
  refused: 0,
  gap_began_m: 61.4,
  gap_now_m: 1.6,
  std_horizontal_m: 0.8,
  effect: 'used',
  effect_text: 'where it has itself was 61 m from the estimate, and is 2 m',
};

function check(...oks: (boolean | null)[]): AidingCheck {
  const parameters = oks.map((ok, at) => ({ name: `P${at}`, value: ok === null ? null : 1, should_be: '1', ok, text: '' }));
  return {
    forms: ['external_position'], form: 'external_position', last_resort: false, parameters, parameters_ok: null, to_do: '',
    objection: '', status: AIDING,
  };
}

describe('the effect', () => {
  it('is what the station says of it', () => {
    expect(aidingEffect(AIDING)).toMatchObject({ text: 'USED', tone: 'good', detail: AIDING.effect_text });
    expect(aidingEffect({ ...AIDING, effect: 'not_used' })).toMatchObject({ text: 'NOT USED', tone: 'bad' });
    expect(aidingEffect({ ...AIDING, effect: 'cannot_tell' })).toMatchObject({ text: 'CANNOT TELL', tone: 'watch' });
  });

  it('is a pause with its reason where nothing is sent', () => {
    const words = aidingEffect({ ...AIDING, sending: false, reason: 'the estimator has lost the place', effect: 'used' });
    expect(words).toMatchObject({ text: 'PAUSED', tone: 'watch' });
    expect(words.detail).toContain('the estimator has lost the place');
  });

  it('is none where it is off', () => {
    expect(aidingEffect(null).text).toBe('off');
    expect(aidingEffect({ ...AIDING, on: false }).text).toBe('off');
  });
});

describe('the gap', () => {
  it('is of now and of the beginning', () => {
    expect(aidingGap(AIDING)).toBe('2 m off now, 61 m when it began');
    expect(aidingGap({ ...AIDING, gap_began_m: null })).toBe('2 m off now');
  });

  it('is not said where it is not known', () => {
    expect(aidingGap({ ...AIDING, gap_now_m: null })).toBe('');
    expect(aidingGap({ ...AIDING, on: false })).toBe('');
  });
});

describe('the check', () => {
  it('counts what is wrong before what is not known', () => {
    expect(checkWords(check(true, true))).toMatchObject({ text: 'parameters are right', tone: 'good' });
    expect(checkWords(check(true, null))).toMatchObject({ text: '1 parameter is not known', tone: 'watch' });
    expect(checkWords(check(false, null, false))).toMatchObject({ text: '2 parameters are wrong', tone: 'bad' });
    expect(checkWords(null).tone).toBe('none');
  });
});
