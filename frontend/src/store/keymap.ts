/** Every key of the page: one list for the dialog, the palette's hints and the guide. */

export interface KeyGroup {
  title: string;
  keys: readonly (readonly [keys: string, what: string])[];
}

export const KEYMAP: readonly KeyGroup[] = [
  {
    title: 'Anywhere but in a field',
    keys: [
      ['Ctrl K', 'All commands'],
      ['?', 'These keys'],
      [',', 'Settings'],
      ['A', 'Acknowledge the gravest alarm'],
      ['1 to 5', 'Open a list: targets, landing, alarms, flights, maps'],
      ['S', 'Show or hide the side panel'],
      ['X', 'Exchange map and video'],
      ['L', 'Next layout'],
      ['O', 'Lay the video on the map'],
      ['F', 'Follow what is clicked'],
      ['Ctrl Z', 'Take back the last deletion, for eight seconds'],
    ],
  },
  {
    title: 'In the video',
    keys: [
      ['Space', 'Pause and play'],
      ['← →', 'One frame back, forward; with Shift a second'],
      ['End', 'Back to live'],
      ['C', 'Crosshair; arrows move it by ten pixels, with Shift by one'],
      ['Enter', 'Target at the crosshair; with Shift named at once'],
      ['Esc', 'Leave the crosshair, or back to live'],
      ['T', 'A camera that can follows the crosshair; with Shift no more'],
    ],
  },
  {
    title: 'In lists and tools',
    keys: [
      ['← →', 'Next tab, where the tabs have the focus'],
      ['F2', 'Rename the target'],
      ['Del', 'Delete the target'],
      ['← → ↑ ↓', 'Move the held frame by a metre, with Shift by 0.2 m, where Adjust has the focus'],
    ],
  },
];
