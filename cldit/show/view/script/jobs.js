// The page's data, and work that it asks of its worker.

const $ = (id) => document.getElementById(id);
const DATA = JSON.parse($("data").textContent);
const HEADS = DATA.items;

// The worker answers jobs in turn.
const worker = new Worker(URL.createObjectURL(
  new Blob([$("worker").textContent], { type: "text/javascript" })));
const waiting = new Map();
let jobs = 0;
worker.onmessage = ({ data }) => {
  const { done, failed } = waiting.get(data.job);
  waiting.delete(data.job);
  if (data.problem) failed(new Error(data.problem));
  else done({ ...data.answer, ms: data.ms });
};
function ask(what, given = {}) {
  return new Promise((done, failed) => {
    waiting.set(++jobs, { done, failed });
    worker.postMessage({ what, job: jobs, ...given });
  });
}

// The arrays of an item go to the worker once; the page keeps no copy.
const loading = [];
function loaded(index) {
  loading[index] ??= (async () => {
    const arrays = {};
    for (const element of document.querySelectorAll(`script[data-item="${index}"]`)) {
      const { name } = element.dataset;
      arrays[name] = { head: HEADS[index].arrays[name], text: element.textContent };
      element.remove();
    }
    knows[index] = (await ask("load", { index, head: HEADS[index], arrays })).has;
  })();
  return loading[index];
}

// Function that begins the work and returns its promise. While it is busy, it keeps only that it was
// asked again, and then works once more, with the state of that moment.
function latest(work) {
  let again = false;
  const run = () => {
    again = run.busy !== null;
    run.busy ??= work().catch(problem).then(() => {
      run.busy = null;
      return again ? run() : null;
    });
    return run.busy;
  };
  run.busy = null;
  return run;
}
