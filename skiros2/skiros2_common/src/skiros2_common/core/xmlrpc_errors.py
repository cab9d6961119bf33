"""The exceptions of a failed XML-RPC call: no server answers, or another kind of server does."""

import http.client
import xmlrpc.client
from xml.parsers.expat import ExpatError

XMLRPC_ERRORS = (OSError, ValueError, http.client.HTTPException, xmlrpc.client.Error, ExpatError)
