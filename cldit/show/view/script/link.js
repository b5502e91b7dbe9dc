// The settings of the page as the fragment of its address, so that a link restores them.

const LINKED = {
  numbers: ["one", "other"],
  names: ["quantity", "colours", "diverging"],
  places: { view: 4, line: 4, limits: 2, apart: 2 }, // lists of so many numbers
};

// state: of the page; asked: pairs of a slider and its value. What is as on a page just opened (`plain`) is omitted.
function linkOf({ line, limits, ...state }, asked, plain) {
  const values = {
    ...state, line: line && line.flat(), limits: limits[state.quantity], apart: limits[`${state.quantity} apart`],
  };
  const lists = Object.keys(LINKED.places);
  const pairs = [...LINKED.numbers, ...LINKED.names, ...lists]
    .filter((name) => values[name] != null && String(values[name]) !== String(plain[name]))
    .map((name) => [name, String(values[name])]);
  if (plain.view && !values.view) pairs.push(["view", "whole"]);
  return new URLSearchParams([...pairs, ...asked]).toString();
}

// The settings {state, asked} of a fragment; what the page does not have (another item, a name of
// no choice, text for a number) is ignored and named in `refused`.
// choices: allowed values of each of the names. count: of items. sliders: names.
function settingsOf(fragment, choices, count, sliders) {
  const state = {}, asked = {}, refused = [];
  for (const [name, text] of new URLSearchParams(fragment.replace(/^#/, ""))) {
    const numbers = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
    const known = numbers.every(Number.isFinite);
    if (LINKED.numbers.includes(name) && Number.isInteger(numbers[0]) && numbers[0] >= 0 && numbers[0] < count) {
      [state[name]] = numbers;
    } else if (LINKED.names.includes(name) && choices[name].includes(text)) state[name] = text;
    else if (name === "view" && text === "whole") state.view = null;
    else if (known && numbers.length === LINKED.places[name] && rising(name, numbers)) state[name] = numbers;
    else if (known && numbers.length === 1 && sliders.includes(name)) [asked[name]] = numbers;
    else refused.push(name);
  }
  const { line, limits, apart, quantity = choices.quantity[0] } = state;
  if (line) state.line = [line.slice(0, 2), line.slice(2)];
  state.limits = { ...(limits && { [quantity]: limits }), ...(apart && { [`${quantity} apart`]: apart }) };
  delete state.apart;
  return { state, asked, refused };
}

// True if each low end is below its high end.
function rising(name, numbers) {
  return name === "line" || numbers.every((number, n) => n % 2 === 0 || number > numbers[n - 1]);
}
