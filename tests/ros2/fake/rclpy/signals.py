class SignalHandlerOptions:
    NO = 0
