"""The OPC UA server: Job Control, robots and the scene as nodes."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import json
import logging
import socket
import time
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from asyncua import ua
from asyncua.crypto.permission_rules import SimpleRoleRuleset, User, UserRole

from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.keys import keep_of
from skiros2_gateway.core.problems import Denied, TooMany, Unauthenticated
from skiros2_gateway.core.received_responses import METHOD
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.opcua.arguments import described, wrong_arguments
from skiros2_gateway.opcua.identity import cell_name, own_certificate
from skiros2_gateway.opcua.job_states import JobStates
from skiros2_gateway.opcua.lists import RESPONSES, JobLists, ListVariable, prepare_before
from skiros2_gateway.opcua.model import CELL_NAMESPACE, PROVIDER_METHODS, JobModel, build_model
from skiros2_gateway.opcua.orders import job_response, order_data, response_data, wanted_states, work_master
from skiros2_gateway.opcua.return_status import ReturnStatus
from skiros2_gateway.opcua.trust_list import TrustingServer, TrustList, is_channel_accepted
from skiros2_gateway.opcua.twin import Twin

log = logging.getLogger(__name__)
# asyncua logs each node of its address space and each request
logging.getLogger("asyncua").setLevel(logging.WARNING)

#: The locale of the comment that is the idempotency key of a command. A private tag (BCP 47): no language has it.
KEY_LOCALE = "x-key"

_caller: ContextVar[Caller | None] = ContextVar("caller", default=None)

#: The most connections, and the longest time from the begin of one to its login (s).
_MAX_CONNECTIONS, _LOGIN_TIMEOUT = 100, 10.0
#: How long changes of jobs are gathered before the lists are sent to clients (s).
_LIST_PERIOD = 0.1
#: The pause after lists were sent, as a multiple of the time that it took: thousands of jobs delay nothing else.
_LIST_PAUSE = 20.0


class _SessionUser(User):
    """A user of a session. Never an administrator: no client changes the address space."""

    def __init__(self, caller: Caller) -> None:
        super().__init__(UserRole.User, caller.user)
        self.caller = caller


class _Users:
    """asyncua's user manager: the token is the password; or the user has a certificate."""

    def __init__(self, service: Service) -> None:
        self._access = service.access

    def get_user(
        self, _: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> _SessionUser | None:
        if not is_channel_accepted():
            log.warning("session of %s refused: its channel has no accepted certificate", username or "a certificate")
            return None
        try:
            if username is not None:
                caller = self._access.authenticate(password or "", "opcua", "opcua")
                return _SessionUser(caller) if caller.user == username else None
            if certificate is not None:
                return _SessionUser(self._access.authenticate_certificate(certificate, "opcua", "opcua"))
        except (Unauthenticated, Denied, TooMany) as error:
            log.info("session of %s refused: %s", username or "a certificate", error)
        return None


class _Rules(SimpleRoleRuleset):
    """Notes whose request is processed: the request and the methods that it calls run in one task.

    A session whose user was removed, or has another token, may no longer do anything.
    """

    def __init__(self, service: Service) -> None:
        super().__init__()
        self._service = service

    def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:
        caller = getattr(user, "caller", None)
        _caller.set(None)  # a request that is refused calls no method for an earlier caller
        if caller is not None:
            try:
                caller = self._service.renew(caller)
            except (Denied, Unauthenticated):
                return False
        _caller.set(caller)
        return bool(super().check_validity(user, action_type_id, body))


class OpcuaServer:
    """The server. To be used in the gateway's loop.

    :param nodesets: the folder of the node set with the types, see `model.NODESET`.
    """

    def __init__(self, service: Service, settings: Settings, nodesets: Path) -> None:
        self._service = service
        self._settings = settings
        self._nodesets = nodesets
        self._server = TrustingServer(user_manager=_Users(service))
        self._model: JobModel
        self._tasks: list[asyncio.Task[None]] = []
        self._lists: JobLists
        self._states: JobStates
        self._has_changes = asyncio.Event()
        #: Its address, once it has started.
        self.address = ""

    async def start(self) -> None:
        """Starts to serve.

        :raises ConfigurationError: the port is in use, the types are not set up, or the certificate cannot be read.
        """
        settings, server = self._settings, self._server
        port = _port(settings.host, settings.opcua_port)  # before the seconds that the rest takes
        await asyncio.to_thread(asyncio.run, self._build())  # seconds, in which the gateway's loop serves others
        server.iserver.max_connections, server.iserver.max_pending_activation_seconds = _MAX_CONNECTIONS, _LOGIN_TIMEOUT
        self.address = f"opc.tcp://{_host(settings.host)}:{port}/skiros2/"
        server.set_endpoint(self.address)
        server.set_server_name("SkiROS2 gateway")
        self._lists = JobLists(self._service, self._model.types)
        self._secure()
        await self._add_objects()
        await server.start()
        log.info("the gateway serves %s", self.address)
        works = (self._follow(), self._twin.follow_elements(), self._write_lists())
        self._tasks = [self._spawn(work) for work in works]

    async def stop(self) -> None:
        """Stops serving."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._server.stop()

    async def _build(self) -> None:
        """Makes the nodes of the types and of job orders, and the certificate. In a loop of its own: nobody waits for
        what it does.
        """
        server, cell = self._server, cell_name(self._settings)
        await server.init()
        identity = await own_certificate(self._settings, cell)
        await server.set_application_uri(identity.uri)
        server.iserver.certificate, server.iserver.private_key = identity.certificate, identity.key
        self._model = await build_model(server, self._nodesets, f"{CELL_NAMESPACE}{cell}")
        self._states = JobStates(server, self._model)
        await self._states.start()

    def _secure(self) -> None:
        """Sets security policies and ways to log in; anonymous users have none."""
        server = self._server
        server.set_certificate_validator(TrustList(self._settings.folder.expanduser() / "opcua"))
        policies = [
            ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
            ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
        ]
        if self._settings.is_local:
            policies.append(ua.SecurityPolicyType.NoSecurity)
        server.set_security_policy(policies, permission_ruleset=_Rules(self._service))
        server.set_identity_tokens([ua.UserNameIdentityToken, ua.X509IdentityToken])

    # -- nodes -------------------------------------------------------------------------------------------------

    async def _add_objects(self) -> None:
        for method in Method:
            takes_order = method in (Method.STORE, Method.STORE_AND_START, Method.UPDATE)
            self._link(method, self._on_order(method) if takes_order else self._on_method(method))
        for name, call in zip(PROVIDER_METHODS, (self._response_by_id, self._responses_by_state), strict=True):
            self._link(name, call)
        self._link(METHOD, self._receive_response)
        masters = [work_master(master) for master in self._service.control.masters.all.values()]
        await self._write("WorkMaster", masters)
        self._twin = Twin(self._server, self._service, self._model.cell)
        await self._twin.start()

    def _link(self, name: str, call: Callable[..., Coroutine[Any, Any, Any]]) -> None:
        method, declared = self._model.children[name], self._model.arguments[name]
        own = self._model.owners[name]

        async def linked(owner: ua.NodeId, *arguments: ua.Variant) -> Any:
            if owner != own.nodeid:
                return ua.StatusCode(ua.StatusCodes.BadMethodInvalid)
            if wrong := wrong_arguments(declared, arguments):
                return wrong
            try:
                return await call(*(argument.Value for argument in arguments))
            except (Denied, Unauthenticated):
                return ua.StatusCode(ua.StatusCodes.BadUserAccessDenied)
            except TooMany:
                return ua.StatusCode(ua.StatusCodes.BadTooManyOperations)

        for each in (method, self._model.type_methods[name]):
            self._server.link_method(each, linked)

    async def _write(self, name: str, value: list[Any]) -> None:
        await self._model.children[name].write_value(ua.Variant(value, ua.VariantType.ExtensionObject, is_array=True))

    # -- methods -----------------------------------------------------------------------------------------------

    def _on_order(self, method: Method) -> Callable[..., Coroutine[Any, Any, Any]]:
        async def call(order: Any, comment: Any = None) -> Any:
            async def carry_out() -> None:
                if method is Method.UPDATE:
                    await self._service.update(caller, data, text)
                else:
                    await self._service.put(caller, data, text, start=method is Method.STORE_AND_START)

            try:
                caller, text, data = _current_caller(), _text(comment), order_data(order)
                return await self._once(caller, method, json.dumps([data, text], default=str), comment, carry_out)
            except SkirosError as error:
                return _status(method, error)

        return call

    def _on_method(self, method: Method) -> Callable[..., Coroutine[Any, Any, Any]]:
        async def call(job_id: str, comment: Any = None) -> Any:
            async def carry_out() -> None:
                await self._service.apply(caller, method, job_id, text)

            try:
                caller, text = _current_caller(), _text(comment)
                return await self._once(caller, method, json.dumps([job_id, text]), comment, carry_out)
            except SkirosError as error:
                return _status(method, error)

        return call

    async def _once(
        self, caller: Caller, method: Method, command: str, comment: Any, carry_out: Callable[[], Awaitable[None]]
    ) -> list[ua.Variant]:
        """Carries out a command once for each idempotency key; see `KEY_LOCALE`. Returns the outputs of the method.

        :raises SkirosError: see `Keys.once`.
        """
        key = next((text.Text or "" for text in comment or [] if text.Locale == KEY_LOCALE), "")
        await self._service.once(caller, key, [method, command], carry_out, keep_of(method.name.lower()))
        return [_status_variant(ReturnStatus.SUCCESS)]

    async def _receive_response(self, response: Any) -> Any:
        try:
            await self._service.receive(_current_caller(), response_data(response))
        except SkirosError as error:
            return _status(METHOD, error)
        return [_status_variant(ReturnStatus.SUCCESS)]

    async def _response_by_id(self, job_id: str) -> list[ua.Variant]:
        self._service.view(_current_caller())
        try:
            response = job_response(self._service.control.get(job_id), self._model.types)
        except UnknownName:
            return [ua.Variant(ua.ISA95JobResponseDataType()), _status_variant(ReturnStatus.UNKNOWN_JOB)]
        return [ua.Variant(response), _status_variant(ReturnStatus.SUCCESS)]

    async def _responses_by_state(self, states: list[Any] | None) -> Any:
        self._service.view(_current_caller())
        try:
            names = wanted_states(states)
        except SkirosError as error:
            return _status("RequestJobResponseByJobOrderState", error, _objects([]))
        jobs = self._service.store.jobs(JobFilter(state=names), limit=RESPONSES)
        found = _objects([job_response(job, self._model.types) for job in jobs])
        return [found, _status_variant(ReturnStatus.SUCCESS)]

    # -- changes -----------------------------------------------------------------------------------------------

    async def _follow(self) -> None:
        self._has_changes.set()
        self._states.know(self._service.control.open_jobs)
        last = self._service.events.last_id
        await self._twin.show_cell()
        await self._show_equipment()
        async for event in self._service.events.follow(last):
            try:
                self._lists.on_event(event)
                await self._twin.on_event(event)
                if event.kind in ("cell", "reset"):
                    await self._show_equipment()
                if event.kind == "job":
                    await self._states.on_job(event.data)
            except Exception:  # one event with a mistake does not cost the others
                log.exception("OPC UA: the event %s of kind %s is not shown", event.id, event.kind)
            if event.kind in ("job", "reset"):
                self._has_changes.set()

    async def _show_equipment(self) -> None:
        """Writes the names that `EquipmentRequirements` of an order may have."""
        names = [robot["name"] for robot in self._service.control.cell.state()["robots"]]
        await self._model.children["EquipmentID"].write_value(ua.Variant(names, ua.VariantType.String, is_array=True))

    async def _write_lists(self) -> None:
        nodes = self._model.children
        orders = ListVariable(self._server, nodes["JobOrderList"], self._lists.orders)
        responses = ListVariable(self._server, nodes["JobOrderResponseList"], self._lists.responses)
        prepare_before(self._server, nodes["JobOrderList"], self._lists.prepare)
        while True:
            await self._has_changes.wait()
            self._has_changes.clear()
            begin = time.thread_time()
            try:
                if orders.is_subscribed:
                    await self._lists.prepare()
                for variable in (orders, responses):
                    if variable.is_subscribed:
                        await variable.send()
            except Exception:
                log.exception("OPC UA: the lists of jobs are not sent")
            await asyncio.sleep(max(_LIST_PERIOD, _LIST_PAUSE * (time.thread_time() - begin)))

    def _spawn(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        async def guarded() -> None:
            try:
                await work
            except Exception:
                log.exception("the OPC UA server no longer follows the gateway")

        return asyncio.get_running_loop().create_task(guarded())


def _current_caller() -> Caller:
    caller = _caller.get()
    if caller is None:
        raise Unauthenticated("the session has no user")
    return caller


def _status(action: str, error: SkirosError, *outputs: ua.Variant) -> ua.CallMethodResult:
    """Returns the result of a refused call: `ReturnStatus` after other outputs, and the reason as diagnostic text.

    :raises Denied, TooMany: they have status codes of OPC UA.
    """
    if isinstance(error, Denied | TooMany | Unauthenticated):
        raise error
    log.info("%s: %s", action, error)
    known = {"unknown_name": ReturnStatus.UNKNOWN_JOB, "refused": ReturnStatus.INVALID_STATE}
    status = _status_variant(known.get(error.code, ReturnStatus.NOT_ACCEPTED))
    return described(ua.StatusCodes.Good, [str(error)], [*outputs, status])


def _status_variant(status: ReturnStatus) -> ua.Variant:
    return ua.Variant(int(status), ua.VariantType.UInt64)


def _objects(values: list[Any]) -> ua.Variant:
    return ua.Variant(values, ua.VariantType.ExtensionObject, is_array=True)


def _text(comment: list[ua.LocalizedText] | None) -> str:
    return " ".join(text.Text or "" for text in comment or [] if text.Locale != KEY_LOCALE)


def _host(host: str) -> str:
    with contextlib.suppress(ValueError):
        return f"[{host}]" if ipaddress.ip_address(host).version == 6 else host
    return host


def _port(host: str, port: int) -> int:
    """Returns the port, or a free one for 0.

    :raises ConfigurationError: it cannot be opened.
    """
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise ConfigurationError(f"opcua_port {port} on {host}: {error.strerror or error}") from error
        return int(probe.getsockname()[1])
