// An evaluated recording: its maps are given, and no slider changes them.

class Measurement {
  constructor(head, arrays) {
    this.head = head;
    this.arrays = arrays;
    this.planck = new Planck(head, arrays);
  }

  get changeable() {
    return false;
  }

  compute() {}

  has(name) {
    return name in this.arrays;
  }

  pixel(name, p) {
    return this.arrays[name][p];
  }

  image(name) {
    return this.arrays[name];
  }
}
