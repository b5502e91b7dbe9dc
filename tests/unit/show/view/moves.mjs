// Times of moves of sliders by the page's own worker, without a browser.
//
// node moves.mjs SCRIPT GIVEN: a file of JavaScript, and one of JSON with {head, arrays}. Prints the
// milliseconds of processor time of each move of a slider, from the first one on.

import { readFileSync } from "node:fs";

const [script, given] = process.argv.slice(2).map((path) => readFileSync(path, "utf8"));
const { answers } = new Function(`let onmessage;\n${script}\nreturn { answers };`)();
await answers.load({ index: 0, ...JSON.parse(given) });
answers.colours({ tables: { grey: Array.from({ length: 768 }, (_, n) => Math.floor(n / 3)) } });
const panels = [{ items: [0], quantity: "temperature", colours: "grey", limits: null }];
answers.draw({ panels, asked: {} });
const sliders = { wall_K: [400, 10], emissivity: [0.7, 0.02], highest_K: [600, 10], shots: [2, 3] };
const moves = Object.entries(sliders).flatMap(([name, [first, step]]) => (
  Array.from({ length: 10 }, (_, n) => ({ [name]: first + n * step }))));
const times = moves.map((asked) => {
  const start = process.cpuUsage();
  answers.draw({ panels: [{ ...panels[0], limits: [300, 600] }], asked });
  const { user, system } = process.cpuUsage(start);
  return (user + system) / 1000;
});
console.log(JSON.stringify(times));
