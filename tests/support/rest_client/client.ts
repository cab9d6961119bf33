/** A job's life by types that are generated from the OpenAPI document. Arguments: address, token. */
import createClient from "openapi-fetch";
import type { components, paths } from "./api.js";

type Job = components["schemas"]["JobData"];

const [baseUrl, token] = process.argv.slice(2);
const cell = createClient<paths>({ baseUrl, headers: { Authorization: `Bearer ${token}` } });
const key = { header: { "Idempotency-Key": "typescript" } };
const order = { id: "typescript", goal: "(at robot home)", start: false };

const states: Job["state"][] = [];
for (let i = 0; i < 2; i++) {
  const { data, error } = await cell.POST("/api/jobs", { params: key, body: order });
  if (!data) throw new Error(error.detail);
  states.push(data.state);
}
const path = { job_id: order.id, method: "cancel" };
const cancelled = await cell.POST("/api/jobs/{job_id}/{method}", { params: { path }, body: { comment: "tests" } });
states.push(cancelled.data!.state);
const again = await cell.POST("/api/jobs/{job_id}/{method}", { params: { path } });
const wrong = await cell.POST("/api/jobs", { body: { ...order, id: "" } });
const ids: string[] = [];
let after: number | null | undefined;
do {
  const page = await cell.GET("/api/jobs", { params: { query: { limit: 1, cleared: true, after } } });
  ids.push(...page.data!.jobs.map((job) => job.id));
  after = page.data!.next;
} while (after);
console.log(JSON.stringify({
  states, ids, refused: again.error?.code, status: again.response.status, problem: wrong.error?.problems?.[0].where,
}));
