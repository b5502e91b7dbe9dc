// Maps of runs by the page's own script, without a browser.
//
// node maps.mjs SCRIPT GIVEN: a file of JavaScript, and one of JSON with [{head, arrays, asked}, ..].
// Prints a list of {quantity: values of every pixel} and the scene that was evaluated.

import { readFileSync } from "node:fs";

const [script, given] = process.argv.slice(2).map((path) => readFileSync(path, "utf8"));
const { TracedRun, unpacked } = new Function(`${script}\nreturn { TracedRun, unpacked };`)();
const NAMES = ["temperature", "temperature_error", "emissivity", "emissivity_error", "reason"];

const found = [];
for (const { head, arrays, asked } of JSON.parse(given)) {
  const read = {};
  for (const [name, one] of Object.entries(arrays)) read[name] = await unpacked(one.head, one.text);
  const run = new TracedRun(head, read);
  run.compute(asked);
  const maps = NAMES.map((name) => [name, Array.from(run.image(name), (one) => (one === one ? one : null))]);
  found.push({ ...Object.fromEntries(maps), scene: run.scene });
}
console.log(JSON.stringify(found, (_, one) => (one === Infinity ? "Infinity" : one)));
