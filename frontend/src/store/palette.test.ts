import { describe, expect, it } from 'vitest';
import { found, matchScore } from './palette';

const ACTIONS = [
  { id: 'a', group: 'Layout', label: 'Map alone' },
  { id: 'b', group: 'Map', label: 'Follow the aircraft' },
  { id: 'c', group: 'Colours', label: 'Sunlight, high contrast' },
  { id: 'd', group: 'Video', label: 'Follow clicks' },
];
const ids = (query: string) => found(ACTIONS, query).map((action) => action.id);

describe('palette', () => {
  it('shows everything when nothing is typed', () => {
    expect(ids('  ')).toEqual(['a', 'b', 'c', 'd']);
  });

  it('finds by the beginnings of words in any order and case', () => {
    expect(ids('CON high')).toEqual(['c']);
    expect(ids('follow')).toEqual(['b', 'd']);
    expect(ids('nothing like it')).toEqual([]);
  });

  it('prefers the label to the group, and a beginning to a middle', () => {
    expect(ids('map')).toEqual(['a', 'b']);
    expect(matchScore('Follow clicks', 'cli')!).toBeGreaterThan(matchScore('Follow clicks', 'lick')!);
  });

  it('takes letters that mean something to expressions as letters', () => {
    expect(ids('(')).toEqual([]);
    expect(matchScore('Zoom (in)', '(in)')).not.toBeNull();
  });
});
