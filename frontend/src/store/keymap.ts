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
      ['1 to 7', 'Open a list: targets, fly, plan, landing, alarms, flights, maps'],
      ['S', 'Show or hide the side panel'],
      ['X', 'Exchange map and video'],
      ['V', 'Next layout'],
      ['L', 'Back to now'],
      ['O', 'Lay the video on the map'],
      ['F', 'Follow what is clicked'],
      ['Ctrl Z', 'Take back the last deletion, for eight seconds; in the plan the last edit, with Shift do it again'],
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
      ['Enter', 'Close the fence that is drawn'],
      ['Esc', 'Leave a tool of the plan, or the picking of a place'],
      ['F2', 'Rename the target'],
      ['Del', 'Delete the target, or what is picked in the plan'],
      ['← → ↑ ↓', 'Move the held frame by a metre, with Shift by 0.2 m, where Adjust has the focus'],
    ],
  },
];
