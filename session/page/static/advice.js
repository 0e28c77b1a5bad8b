// What would narrow the bands most: asked for when somebody looks, and again when something has changed.
import { $, button, make } from "./dom.js";
import { get } from "./server.js";
import { regions, say, session, state } from "./session.js";
import { one } from "./words.js";

const MOST = 4;         // of a list: the others bring less
let known = null, knownOf = "", asking = "";

export async function showAdvice(selected, does) {
  const { live, digest } = session.state;
  $("advice").hidden = !live?.result?.conditions.length;
  if (!$("advice").open || !live?.result_now) return;
  if (knownOf !== digest && asking !== digest) {
    asking = digest; $("advice-of").textContent = "Working it out …";
    try { known = await get("/api/advice"); knownOf = digest; } catch (error) { say(error.message); }
    asking = "";
  }
  if (knownOf !== session.state.digest) return;
  const mine = known.surfaces[selected], list = (mine ?? known.overall).slice(0, MOST);
  $("advice-of").textContent = known.failed.length ? known.failed.join(" ") : !list.length ? "Nothing on the list would narrow the bands by 2 % or more." : mine ? `Of ${selected}, best first:` : "Of all marked colours, best first:";
  $("advice-list").replaceChildren(...list.map((each) => make("li", {}, make("p", { text: each.says }),
    make("p", { className: "soft", text: `${each.cost}: band ${each.width_before.toFixed(3)} → ${each.width_after.toFixed(3)} wide, colour within ΔE00 ${one(each.colour_before)} → ${one(each.colour_after)}` }),
    hereOf(each.action, selected, does))));
}
// What can be done on the page is a button.
function hereOf(action, selected, { choose, addPhoto }) {
  const photo = { gel: "filter", "second-lamp": "lamp", "lamp-moved": "moved" }[action];
  if (photo) return button("Add that photo", (event) => addPhoto(event.currentTarget, photo));
  if (action === "white-card") return button("Mark the card", () => choose("white"));
  if (action === "matt") return button(selected ? "It is matt" : "All are matt", async () => {
    for (const name of selected ? [selected] : Object.keys(regions()).filter((each) => !regions()[each].stated.known)) await state(name, { surface: "matt" }); });
  return null;
}
