// Questions to the pendant beside the live connection: they read, and change nothing.
export async function ask(what, parameters = {}) {
  const answer = await fetch(`/ask/${what}?${new URLSearchParams(parameters)}`);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).detail ?? `the pendant answers with ${answer.status}`);
  return answer;
}
