// Questions to the pendant beside the live connection: they read, and change nothing.
import { link } from "./link.js";

export async function ask(what, parameters = {}) {
  const answer = await fetch(`/ask/${what}?${new URLSearchParams(parameters)}`);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).detail ?? `the pendant answers with ${answer.status}`);
  return answer;
}

// The same of the arm that the page is about, read as JSON or as `kind` says; null when the page is about another one by then.
export async function askOfArm(what, parameters = {}, kind = "json") {
  const arm = link.chosen;
  try {
    const said = await (await ask(what, { arm, ...parameters }))[kind]();
    return arm === link.chosen ? said : null;
  } catch (error) {
    if (arm === link.chosen) throw error;
    return null;
  }
}
