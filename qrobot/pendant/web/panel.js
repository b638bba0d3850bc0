// An element of NiceGUI whose inside is drawn by a part of `station`.
import { mount } from "qrobot-pendant";

export default {
  template: "<div></div>",
  props: { kind: String },
  mounted() {
    mount(this.kind, this.$el);
  },
};
