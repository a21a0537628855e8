-- What a server of the first release had written when it was killed: one job in every state.
INSERT INTO scenes VALUES ('cornell-hash', 1760000000000,
    '{"id":"cornell-hash","format":"gltf","size":6000,"created_at":"2025-10-09T08:53:20Z","triangles":34,"vertices":68,"materials":4,"textures":0,"lights":2,"bounds":null,"cameras":[{"index":0,"name":"front"}],"warnings":[]}');

INSERT INTO jobs (id, scene_id, state, priority, created_ms, started_ms, finished_ms, attempts,
                  fence, lease_owner, last_seq, idempotency_key, request_hash, request, device,
                  progress, plan, stats, error, result) VALUES
    ('0199c800-0000-7000-8000-000000000001', 'cornell-hash', 'succeeded', 0, 1760000001000,
     1760000002000, 1760000003000, 1, 1, NULL, 4, NULL, 'h1',
     '{"scene":"cornell-hash","method":"auto","camera":null,"width":64,"height":64,"target_error":null,"time_budget_s":null,"max_iterations":16,"seed":7,"snapshots":null,"options":{"patches":500},"priority":0,"labels":{"project":"atrium"}}',
     'cpu', '{"iterations":16,"shots":128,"light_source_selection_ratio":0.5,"estimated_error":null,"seconds":0.5,"seconds_remaining":0.0,"fraction":1.0}',
     '{"method":"stochastic","reasons":[],"settings":{},"patches":500,"triangles":34}',
     '{"method":"stochastic","stopped":"iterations","iterations":16,"shots":128,"light_source_selection_ratio":0.5,"estimated_error":null,"seconds_solve":0.5,"seconds_total":0.6,"patches":500,"triangles":34,"diagnostics":{}}',
     NULL, '[{"format":"png","url":"/v1/jobs/0199c800-0000-7000-8000-000000000001/snapshots/aa.png","sha256":"aa","size":3,"width":64,"height":64}]'),
    ('0199c800-0000-7000-8000-000000000002', 'cornell-hash', 'failed', 0, 1760000001000,
     1760000002000, 1760000003000, 1, 1, NULL, 3, NULL, 'h2',
     '{"scene":"cornell-hash","method":"auto","width":64,"height":64,"seed":0,"options":{},"priority":0,"labels":{}}',
     'cpu', NULL, NULL, NULL, '{"code":"panic","detail":"an unexpected fault: x"}', NULL),
    ('0199c800-0000-7000-8000-000000000003', 'cornell-hash', 'cancelled', 0, 1760000001000,
     NULL, 1760000003000, 0, 0, NULL, 2, NULL, 'h3',
     '{"scene":"cornell-hash","method":"auto","width":64,"height":64,"seed":0,"options":{},"priority":0,"labels":{}}',
     NULL, NULL, NULL, NULL, NULL, NULL),
    ('0199c800-0000-7000-8000-000000000004', 'cornell-hash', 'running', 0, 1760000001000,
     1760000002000, NULL, 1, 1, 'an-earlier-boot', 2, NULL, 'h4',
     '{"scene":"cornell-hash","method":"auto","width":64,"height":64,"seed":0,"options":{},"priority":0,"labels":{}}',
     'cpu', NULL, NULL, NULL, NULL, NULL),
    ('0199c800-0000-7000-8000-000000000005', 'cornell-hash', 'queued', 0, 1760000001000,
     NULL, NULL, 0, 0, NULL, 1, 'key-5', 'h5',
     '{"scene":"cornell-hash","method":"auto","width":64,"height":64,"seed":0,"options":{},"priority":0,"labels":{}}',
     NULL, NULL, NULL, NULL, NULL, NULL);

INSERT INTO job_labels VALUES ('0199c800-0000-7000-8000-000000000001', 'project', 'atrium');

INSERT INTO events VALUES
    ('0199c800-0000-7000-8000-000000000001', 1, 'state', 1760000001000, '{"state":"queued","attempts":0}'),
    ('0199c800-0000-7000-8000-000000000001', 2, 'state', 1760000002000, '{"state":"running","attempts":1}'),
    ('0199c800-0000-7000-8000-000000000001', 3, 'progress', 1760000002500, '{"fence":1,"iterations":16,"shots":128,"light_source_selection_ratio":0.5,"estimated_error":null,"seconds":0.5,"seconds_remaining":0.0,"fraction":1.0}'),
    ('0199c800-0000-7000-8000-000000000001', 4, 'succeeded', 1760000003000, '{"state":"succeeded","attempts":1,"pictures":[{"format":"png","url":"/v1/jobs/0199c800-0000-7000-8000-000000000001/snapshots/aa.png","sha256":"aa","size":3,"width":64,"height":64}]}'),
    ('0199c800-0000-7000-8000-000000000002', 3, 'failed', 1760000003000, '{"state":"failed","attempts":1,"error":{"code":"panic","detail":"an unexpected fault: x"}}'),
    ('0199c800-0000-7000-8000-000000000004', 2, 'state', 1760000002000, '{"state":"running","attempts":1}');

INSERT INTO pictures VALUES ('0199c800-0000-7000-8000-000000000001', 4, 'aa', 'png',
    '{"format":"png","url":"/v1/jobs/0199c800-0000-7000-8000-000000000001/snapshots/aa.png","sha256":"aa","size":3,"width":64,"height":64}');
