// Settings of the page to its address and back, without a browser.
//
// node link.mjs SCRIPT: a file of JavaScript. Prints the fragment of some settings, what is read of
// it, and what is read of a fragment with errors.

import { readFileSync } from "node:fs";

const script = readFileSync(process.argv[2], "utf8");
const { linkOf, settingsOf } = new Function(`${script}\nreturn { linkOf, settingsOf };`)();
const plain = { one: 0, other: null, quantity: "temperature", colours: "cividis", diverging: "RdBu_r", line: null, view: [-10, 10, -40, 0] };
const choices = { quantity: ["temperature", "emissivity"], colours: ["cividis", "hue"], diverging: ["RdBu_r"] };
const read = (fragment) => settingsOf(fragment, choices, 3, ["wall_K", "shots"]);
const changed = {
  ...plain, one: 2, other: 0, quantity: "emissivity", colours: "hue", view: null, line: [[-20, 0.5], [20, -1.25]],
  limits: { temperature: [300, 400], emissivity: [0, 0.25], "emissivity apart": [-0.1, 0.1] },
};
const fragment = linkOf(changed, [["wall_K", 515.5]], plain);
console.log(JSON.stringify({
  untouched: linkOf({ ...plain, limits: {} }, [], plain),
  read: read(`#${fragment}`),
  refused: read("#one=3&colours=red&view=1,2,3&limits=5,4&wall_K=hot&x=1&shots=4").refused,
}));
