// What the page was made with.

const $ = (id) => document.getElementById(id);
const DATA = JSON.parse($("data").textContent);
const HEADS = DATA.items;
